"""What is measured in a file, in one pass."""

from __future__ import annotations

from dataclasses import dataclass, field

import hardspheres as hs
from analysis.distributions import ComponentDistribution, SpeedDistribution
from analysis.maxwell_test import MaxwellTest
from analysis.moments import VelocityMoments
from analysis.structure import PairDistribution
from studies.analyse.gas_in_file import GasInFile

__all__ = ["Findings", "findings"]

REACH = 4.0  # of g(r) of particles of unknown radius, in mean distances
LEAST_DEPTH = 0.3  # beyond contact, in diameters, for a contact value


@dataclass
class Findings:
    """What was measured in a file.

    Attributes
    ----------
    gas : GasInFile
        The gas.
    moments, test, speeds, components
        Estimators of velocities; nothing is added to them where there are none.
    pairs : PairDistribution or None
        Pair distribution, where there can be one.
    notes : list of str
        What could not be measured, and why.
    """

    gas: GasInFile
    moments: VelocityMoments = field(default_factory=VelocityMoments)
    test: MaxwellTest = field(default_factory=MaxwellTest)
    speeds: SpeedDistribution = field(default_factory=SpeedDistribution)
    components: list[ComponentDistribution] = field(default_factory=list)
    pairs: PairDistribution | None = None
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        """Return of which file they are, and the moments."""
        return f"<Findings in {self.gas!r}: {self.moments!r}>"

    def begin(self, scene: hs.Scene) -> None:
        """Look at the first frame, and decide what can be measured."""
        if scene.n < 2:
            raise hs.TrajectoryError(f"{self.gas.path} holds one particle; a gas has two or more")
        self.components = [ComponentDistribution(axis) for axis in range(scene.dim)]
        none = self._no_pairs(scene)
        if not none:
            return
        if not self.gas.moving:
            lacking = "all particles are at rest" if self.gas.at_rest else "there are no velocities"
            raise hs.TrajectoryError(f"{self.gas.path}: {lacking}, and there is no g(r): {none}")
        self.notes.append(f"no g(r): {none}")

    def _no_pairs(self, scene: hs.Scene) -> str:
        """Prepare g(r); return why there is none, if so."""
        gas = self.gas
        if not gas.boxed:
            return "the box is not known; --box 10,10,10 gives its edges"
        if not scene.periodic.all():
            return "the box has walls"
        largest, half = 2.0 * float(scene.radii.max()), float(scene.box.min()) / 2.0
        if gas.sized:
            depth = min(1.0, (half / largest - 1.0) * (1.0 - 1e-12))
            if depth < LEAST_DEPTH:
                return f"the box is only {2.0 * half / largest:.3g} diameters wide"
            self.pairs = PairDistribution(depth=depth, bins=max(round(100 * depth), 60))
        else:
            if not gas.points:
                self.notes.append("no radii in the file, so no contact value; --radius 0.5 gives them")
            spacing = float(scene.number_density ** (-1.0 / scene.dim))
            depth = min(REACH * spacing, 0.999 * half) / largest - 1.0
            self.pairs = PairDistribution(depth=depth, window=depth)
        return ""

    def add(self, frame: hs.Frame) -> None:
        """Take in a frame."""
        if self.pairs is not None and self.gas.steady:
            self.pairs.add(frame)
        if not self.gas.moving:
            return
        for each in (self.moments, self.test, self.speeds, *self.components):
            each.add(frame)


def findings(gas: GasInFile) -> Findings:
    """Read a file and measure the gas in it, in one pass.

    Parameters
    ----------
    gas : GasInFile
        Not read yet.

    Raises
    ------
    TrajectoryError, SceneError
        If it cannot be read, or there is nothing to be measured.
    """
    found = Findings(gas)
    for index, frame in enumerate(gas.frames()):
        if index == 0:
            found.begin(gas.scene)
        try:
            found.add(frame)
        except ValueError as error:
            raise hs.TrajectoryError(f"{gas.path}: frame {index}: {error}") from error
    if not gas.steady and found.pairs is not None:
        found.pairs = None
        found.notes.append("no g(r): the box is not the same in all frames")
    return found
