"""The errors of the package: one base class, one subclass per place where a user can go wrong."""


class HardSpheresError(Exception):
    """Base of every error that this package raises on purpose."""


class SceneError(HardSpheresError, ValueError):
    """An invalid scene: shapes, values, overlaps or box. The message names value, place and remedy."""


class SimulationError(HardSpheresError, RuntimeError):
    """A run that cannot continue: no collision to come, or time does not advance."""


class InvariantError(HardSpheresError, AssertionError):
    """An invariant of the dynamics broke (energy, momentum, overlap); raised by `Simulation.check`."""


class TrajectoryError(HardSpheresError, ValueError):
    """A trajectory or structure file that cannot be read or written."""


class CheckpointError(HardSpheresError, ValueError):
    """A checkpoint that is torn, altered, or of another version."""
