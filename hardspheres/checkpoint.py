"""Checkpoints: a simulation in a file, which continues from it bit for bit, later and on any machine.

The rows are the canonical state (`hardspheres.kernel`), so pending events, neighbour lists and windows are
not stored: they are computed again from the rows. Stored are the scene that the simulation began with (from
which shells and windows follow), the present length of its epochs, the state that `kernel.layout` names, the
clock, where the tallies began, and what was counted before. Every number is checked before kernels use it.

A checkpoint of another version of the package is accepted if the version of the format is the same. That
version changes with the content of the file and with every change to the bits of a trajectory.
"""

import json
import math
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from hardspheres import __version__
from hardspheres.archive import Arrays, read_archive, write_archive
from hardspheres.clock import FOREVER
from hardspheres.engine import Engine
from hardspheres.errors import CheckpointError, SceneError
from hardspheres.event_log import sink_of
from hardspheres.scene import LEFT_BY_ROUNDING, Scene, contact_tolerance

if TYPE_CHECKING:
    from hardspheres.simulation import Simulation

    AnySimulation = TypeVar("AnySimulation", bound=Simulation)

FORMAT = "hardspheres checkpoint"
VERSION = 3
SCENE = ("positions", "velocities", "radii", "masses", "box")


def save(sim: "Simulation", path: str | PathLike[str]) -> None:
    """Write a simulation to a file; see `Simulation.save`.

    Parameters
    ----------
    sim : Simulation
        Any; it is not changed.
    path : path
        The file, replaced whole.

    Raises
    ------
    CheckpointError
        When the file cannot be written.
    """
    write_archive(path, to_arrays(sim))


def load(
    cls: "type[AnySimulation]", path: str | PathLike[str], log: Any = None, search: str = "auto"
) -> "AnySimulation":
    """Return the simulation in a file; see `Simulation.load`.

    Parameters
    ----------
    cls : type
        `Simulation`.
    path : path
        A file written by `save`.
    log : callable or path, optional
        As of `Simulation`, for the events from now on.
    search : str
        As of `Simulation`.

    Returns
    -------
    Simulation
        As it was.

    Raises
    ------
    CheckpointError
        When the file cannot be used.
    """
    arrays = read_archive(path)
    try:
        return from_arrays(cls, arrays, log, search)
    except CheckpointError as error:
        raise CheckpointError(f"{path} cannot be used: {error}") from None


def to_arrays(sim: "Simulation") -> Arrays:
    """Return the arrays of a checkpoint of a simulation (views)."""
    sim._engine.keep_clock()
    engine = sim._engine = sim._engine.in_pace()
    about = {
        "format": FORMAT,
        "version": VERSION,
        "package": __version__,
        "boundary": list(sim.scene.boundary),
        "epoch_length": engine.length,
        "clock": list(engine.now),
        "tallied_since": list(engine.since),
    }
    text = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    scene = {name: getattr(sim.scene, name) for name in SCENE}
    arrays: Arrays = {"about": text} | scene | engine.state()
    return arrays


def restored(
    cls: "type[AnySimulation]", scene: Scene, arrays: Arrays, log: Any = None, search: str = "auto"
) -> "AnySimulation":
    """Return a new simulation in the state that `to_arrays` gave, unchecked; used for copies.

    Parameters
    ----------
    cls : type
        `Simulation`.
    scene : Scene
        Where it started.
    arrays : dict of str to array
        From `to_arrays`; copied.
    log : callable, optional
        Takes the events from now on.
    search : str
        As of `Simulation`.

    Returns
    -------
    Simulation
        With arrays of its own.
    """
    about = json.loads(arrays["about"].tobytes())
    sim = cls(scene, free_paths="flight" in arrays and log is None, log=log, search=search)
    if about["epoch_length"] != sim._engine.length:
        sim._engine = sim._engine.with_epochs(about["epoch_length"])
    _take_over(sim._engine, arrays, about)
    return sim


def _take_over(engine: Engine, arrays: Arrays, about: dict[str, Any]) -> None:
    engine.restore(arrays)
    engine.now, engine.since = tuple(about["clock"]), tuple(about["tallied_since"])


def from_arrays(
    cls: "type[AnySimulation]", arrays: Arrays, log: Any = None, search: str = "auto"
) -> "AnySimulation":
    """Return the simulation that consists of these arrays; CheckpointError where there is none."""
    about = _read_about(arrays)
    flights = "flight" in arrays
    if log is not None and not flights:
        raise CheckpointError(
            "log=... needs what only a simulation with free_paths=True or a log keeps, and this was none"
        )
    placeholder = None if log is None else _not_yet
    sim = cls(_scene(arrays, about), free_paths=flights and log is None, log=placeholder, search=search)
    engine = sim._engine = _with_epochs(sim._engine, about["epoch_length"])
    _require_like(arrays, engine.state())
    _require_state(engine, arrays, about)
    _take_over(engine, arrays, about)
    _require_as_left(sim)
    if log is not None:  # last, after all checks: it starts its file anew
        engine.sink = sink_of(log, engine.scene.dim)
    return sim


def _not_yet(events: Any) -> None:
    """Take the place of the log until the checkpoint has passed its checks."""


def _read_about(arrays: Arrays) -> dict[str, Any]:
    """Return the header of the file, every value checked by type and range."""
    try:
        about = json.loads(arrays["about"].tobytes())
        if about["format"] != FORMAT:
            raise ValueError
    except (KeyError, TypeError, ValueError, RecursionError):
        raise CheckpointError("it does not say that it is a checkpoint of hardspheres") from None
    if about.get("version") != VERSION:
        raise CheckpointError(
            f"its format is version {about.get('version')!r}, written by hardspheres "
            f"{about.get('package')!r}; this one reads version {VERSION}"
        )
    clock, since = about.get("clock"), about.get("tallied_since")
    if not _is_list(about.get("boundary"), str, str, str) and not _is_list(about.get("boundary"), str, str):
        raise CheckpointError("its boundary is not a list of words")
    if not _is_list(clock, int, float) or not _is_list(since, int, float, int, int):
        raise CheckpointError("its clock or the start of its tallies is invalid")
    if not _is_list([about.get("epoch_length")], float):
        raise CheckpointError("its epoch has no length")
    return dict(about)


def _is_list(values: Any, *types: type) -> bool:
    """Whether this is a list of these types, with integers in range and floats finite and not negative."""
    if not isinstance(values, list) or [type(value) for value in values] != list(types):
        return False
    return all(isinstance(value, str) or (0 <= value < FOREVER and math.isfinite(value)) for value in values)


def _scene(arrays: Arrays, about: dict[str, Any]) -> Scene:
    missing = [name for name in SCENE if name not in arrays]
    if missing:
        raise CheckpointError(f"it has no {missing[0]}")
    try:
        positions, velocities, radii, masses, box = (arrays[name] for name in SCENE)
        return Scene.as_left(positions, velocities, radii, masses, box, tuple(about["boundary"]))
    except SceneError as error:
        raise CheckpointError(f"its scene is impossible: {error}") from None


def _with_epochs(engine: Engine, length: float) -> Engine:
    """Return the engine with the epoch length of the file, if runs of this scene can reach that length."""
    usual = engine.length
    mantissa, _ = math.frexp(length)
    if length == usual:
        return engine
    change = math.isfinite(float(engine.arrays.number[engine.layout.UPPER_MEAN_SQUARE]))
    if not (change and mantissa == 0.5 and 2.0**-60 * usual <= length < usual):
        raise CheckpointError(f"its epochs are {length!r} long, but this scene's are {usual!r}")
    return engine.with_epochs(length)


def _require_like(arrays: Arrays, fresh: Arrays) -> None:
    """Require exactly the arrays of a fresh simulation of the scene, by name, type and shape."""
    names = {"about", *SCENE, *fresh}
    if set(arrays) != names:
        raise CheckpointError(f"it holds {sorted(set(arrays) ^ names)} too much or too little")
    for name, array in fresh.items():
        given = arrays[name]
        if given.dtype != array.dtype or given.shape != array.shape:
            raise CheckpointError(
                f"{name} is {given.dtype} of shape {given.shape}; this scene has {array.dtype} of shape "
                f"{array.shape}"
            )
        if given.dtype.kind == "f" and not np.isfinite(given).all():
            raise CheckpointError(f"{name} holds a value that is not finite")


def _require_state(engine: Engine, arrays: Arrays, about: dict[str, Any]) -> None:
    """Require rows, clocks and counters that runs of this scene can reach, as far as the kernels need it."""
    at, scene, length = engine.layout, engine.scene, engine.length
    counters = dict(zip(at.STATE_COUNTERS, arrays["counters"].tolist(), strict=True))
    numbers = dict(zip(at.STATE_NUMBERS, arrays["numbers"].tolist(), strict=True))
    epoch, moment = about["clock"]
    counts = [*counters.values(), *arrays["counts"].tolist()]
    if engine.flights:
        counts += arrays["earlier_counts"].tolist()
    if not all(0 <= count < FOREVER for count in counts) or not np.all(
        (arrays["turns"] > -FOREVER) & (arrays["turns"] < FOREVER)
    ):
        raise CheckpointError("a counter is out of range")
    now = max(numbers[at.NOW], 0.0)
    if counters[at.EPOCH] != epoch or not now <= moment <= length or numbers[at.LAST_ADVANCE] > now:
        raise CheckpointError("its clocks contradict each other")
    since = about["tallied_since"]
    if since[:2] > [epoch, moment] or since[2] > counters[at.PAIRS] or since[3] > counters[at.WALL_HITS]:
        raise CheckpointError("its tallies begin after its time")
    _require_rows(scene, engine.rows, arrays["row"], at, now)
    if engine.flights:
        _require_flights(arrays, engine.state(), at, epoch, length)


def _require_flights(arrays: Arrays, fresh: Arrays, at: Any, epoch: int, length: float) -> None:
    """Require flights that fit the species of the scene and began before now, or are marked as unknown."""
    flight, began_fresh = (a["flight"].reshape(-1, at.FLIGHT) for a in (arrays, fresh))
    began, began_epoch = flight[:, at.BEGAN], flight[:, at.BEGAN_EPOCH]
    if not np.array_equal(flight[:, at.SPECIES], began_fresh[:, at.SPECIES]) or not np.all(
        (began >= 0.0)
        & (began <= length)
        & (began_epoch >= -1.0)
        & (began_epoch <= epoch)
        & (began_epoch == np.floor(began_epoch))
    ):
        raise CheckpointError("its free flights are not of this scene")


def _require_rows(scene: Scene, fresh: Any, rows: Any, at: Any, now: float) -> None:
    """Require times within this epoch, the initial energy, and positions that particles can have reached."""
    x, v, t = rows[:, at.X : at.X + scene.dim], rows[:, at.V : at.V + scene.dim], rows[:, at.T]
    used = at.T + 1
    if not np.array_equal(rows[:, used:], fresh[:, used:]):
        raise CheckpointError("its rows have other radii than its scene")
    if not np.all((t >= 0.0) & (t <= now)):
        raise CheckpointError("a row is of a time outside of the present epoch")
    with np.errstate(over="ignore"):
        energy = 0.5 * float(np.sum(scene.masses * np.sum(v * v, axis=1)))
    if not abs(energy - scene.kinetic_energy) <= 1e-6 * scene.kinetic_energy:
        raise CheckpointError(
            f"its kinetic energy is {energy:.6g}, that of its scene {scene.kinetic_energy:.6g}"
        )
    fastest = np.sqrt(2.0 * energy / scene.masses)
    spare = _spare(scene)
    flown = np.where(scene.periodic, (1.0 + 1e-6) * (fastest * t)[:, None], 0.0)
    margin = np.where(scene.periodic, 0.0, scene.radii[:, None])
    if not np.all((x >= margin - flown - spare) & (x <= scene.box - margin + flown + spare)):
        raise CheckpointError("a particle is further from the box than it can have flown")


def _spare(scene: Scene) -> float:
    """Upper bound on the rounding error of a coordinate."""
    return max(4.0 * contact_tolerance(scene.box), LEFT_BY_ROUNDING * 2.0 * float(scene.radii.max()))


def _require_as_left(sim: "Simulation") -> None:
    overlap = sim.worst_overlap
    if not overlap <= max(LEFT_BY_ROUNDING, _spare(sim.scene) / (2.0 * float(sim.scene.radii.min()))):
        raise CheckpointError(f"its particles overlap by {overlap:.3g} diameters")
