"""Lorentz gas: a particle among fixed obstacles, its free path, diffusion and Lyapunov exponent."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis.lorentz import LAGS, PLACES, SURVIVAL_AT, LorentzWalk
from analysis.statistics import Estimate, estimate_from_replicas, replica_mean
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import check_length, check_spread
from studies.noticing import Notices
from studies.obstacle_course import ARRANGEMENTS, ObstacleCourse
from studies.options import option, packing_fractions, runs, word
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from studies.viewer.replay import Replay

__all__ = ["Lorentz"]

FloatArray = NDArray[np.float64]

USUAL = {"triangular": (0.7, 0.8), "square": (0.13, 0.3, 0.5), "random": (0.05, 0.2)}
OF_RANDOM, FEWEST = 500, 16  # obstacles at random in the box: by default, and at least
SPACING = 0.5  # mean free times between two places
WINDOW = 32, 128  # lags between which the slope is D, in spacings
SHORTEST = PLACES * SPACING  # collisions in a block
SHOWN, DRAWN = 200.0, 60  # collisions in gas.html; of the track in the picture


@dataclass(frozen=True, kw_only=True)
class Lorentz(Study):
    """One particle among fixed obstacles, in many runs: a Lorentz gas, in which particles never meet."""

    name = "lorentz"
    question = "How does a particle find its way among fixed obstacles?"
    explanation = """
    A Lorentz gas: a particle among fixed discs or spheres, one in each replica, since particles do not meet.
    Its mean free path beside Santalo's exact one, how far it gets and, where there is one, its diffusion
    coefficient, lengths of flights, and the Lyapunov exponent, beside theory. On a square lattice it is
    Sinai's billiard; --obstacles random is a porous medium. Writes a summary, three tables, a picture and a
    page with the particle to be watched.
    """
    table = "lorentz"
    files = ("lorentz.csv", "displacement.csv", "free_path_survival.csv", "lorentz.png", "gas.html")

    obstacles: str = option("triangular", "How they lie.", **word("--obstacles", *ARRANGEMENTS))
    packing_fractions: tuple[float, ...] | None = option(
        None,
        "Obstacles per volume times the volume of a ball with the radius of an obstacle and the particle "
        "together: one, several with commas, or first:last:count.",
        flag="--packing-fraction",
        shown="0.7,0.8; square: 0.13,0.3,0.5; random: 0.05,0.2",
        parser=packing_fractions,
        metavar="NUMBER|LIST",
    )
    dim: int = option(2, "Dimension; a square lattice is simple cubic in 3D.", at_least=2, at_most=3)
    n: int | None = option(
        None, "Obstacles at random in the box.", at_least=FEWEST, shown=f"{OF_RANDOM}", metavar="NUMBER"
    )
    size: float = option(
        0.1,
        "Diameter of the particle over that of an obstacle; results depend on the sum of both alone.",
        at_least=1e-6,
        at_most=1.0,
    )
    collisions_per_particle: float = option(60_000.0, "How long to follow it in each replica, in collisions.")
    replicas: int = runs(16)
    threads: ClassVar[int] = 1  # type: ignore[misc]  # no option: one particle moves

    def gases(self) -> list[ObstacleCourse]:
        """Return the courses, by ascending packing fraction."""
        at_random = self.obstacles == "random"
        if self.n is not None and not at_random:
            raise hs.SceneError(f"--n {self.n} needs --obstacles random: a lattice is endless in any box")
        check_length(self.collisions_per_particle, SHORTEST, "is too short to see the particle diffuse")
        check_spread(self.replicas)
        count = (self.n or OF_RANDOM) if at_random else 0
        found = []
        for eta in self.packing_fractions or USUAL[self.obstacles]:
            found.append(ObstacleCourse(self.obstacles, self.dim, eta, count, self.size))
            found[-1].check()
        return found

    def start(self, gas: ObstacleCourse, seed: np.random.SeedSequence) -> hs.Simulation:
        """Return the particle, with what a log needs."""
        return hs.Simulation(gas.scene(seed), free_paths=True)

    def estimators(self, gas: ObstacleCourse, simulation: hs.Simulation) -> dict[str, Any]:
        """Return what follows it."""
        return {"walk": LorentzWalk(SPACING * gas.free_path, gas.free_path)}

    def advance(self, gas: ObstacleCourse, replica: Replica) -> Iterator[None]:
        """Follow it block by block, by its events."""
        walk, chunks = replica.estimators["walk"], list[NDArray[np.void]]()
        replica.running = simulation = replica.simulation.with_log(chunks.append)
        while replica.done < math.ceil(self.collisions_per_particle / SHORTEST):
            start = simulation.frame()
            simulation.run(time=walk.block)
            walk.add(start, chunks)
            chunks.clear()
            replica.done += 1
            yield

    def answer(self, gas: ObstacleCourse, replicas: Sequence[Replica]) -> Answer:
        """Return what all replicas say, with errors from their spread."""
        walks = [replica.estimators["walk"] for replica in replicas]
        squares = np.array([walk.mean_square_displacement for walk in walks])
        t = SPACING * gas.free_path * LAGS
        rate = estimate_from_replicas([walk.collisions / walk.time for walk in walks])
        path = replace(rate, value=1.0 / rate.value, standard_error=rate.standard_error / rate.value**2)
        numbers, notices = [number("mean free path", path, "Santalo", gas.free_path)], Notices()
        if gas.finite_horizon:
            with notices.of("diffusion coefficient"):
                numbers.append(number("diffusion coefficient", _slope(squares, t, gas.dim), *gas.diffusion))
        growth, collisions = (np.array([getattr(w, name) for w in walks]) for name in ("growth", "stretched"))
        exponent = estimate_from_replicas(growth / collisions)
        with notices.of("Lyapunov exponent"):
            numbers.append(number("Lyapunov exponent per collision", exponent, *gas.exponent))
        longer = np.array([1.0 - np.cumsum(walk.flights)[:-1] / walk.flights.sum() for walk in walks])
        curves = {
            "displacement": Curves(
                {"mean_free_times": SPACING * LAGS, "t": t},
                {
                    "square": Column(*replica_mean(squares)),
                    "diffusion": Column(*replica_mean(squares / (2 * gas.dim * t))),
                },
            ),
            "free_path_survival": Curves(
                {"mean_free_paths": SURVIVAL_AT}, {"survival": Column(*replica_mean(longer))}
            ),
        }
        large, small = gas.radii
        return Answer(
            gas,
            numbers,
            curves,
            notices.notes,
            alarms(numbers),
            details={"obstacle_radius": large, "particle_radius": small, "box": gas.box.tolist()},
            hidden={"track": self._track(gas)},
        )

    def _track(self, gas: ObstacleCourse) -> tuple[hs.Scene, FloatArray]:
        """Return a start, and places of the first collisions, for the picture."""
        scene, chunks = gas.scene(np.random.SeedSequence(self.seed, spawn_key=(0,))), list[NDArray[np.void]]()
        walk = LorentzWalk(gas.free_path * DRAWN / PLACES, gas.free_path)
        simulation = hs.Simulation(scene, log=chunks.append)
        start = simulation.frame()
        simulation.run(time=walk.block)
        return scene, walk.places(start, chunks)

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        one = answers[0].gas
        unit = "mean distance n^(-1/d) of obstacles" if one.obstacles else "spacing of the lattice"
        large, small = one.radii
        found = [
            f"unit of length: {unit}; speed 1; radius of the particle {small:.4g}, of an obstacle {large:.4g}"
            + (f", at packing fraction {one.packing_fraction:g}" if len(answers) > 1 else ""),
            "packing fraction: of balls whose radius is the sum of both, which its centre cannot enter"
            + (", overlaps counted twice" if one.obstacles else ""),
        ]
        low, high = (SPACING * lag for lag in WINDOW)
        if any(answer.gas.finite_horizon for answer in answers):
            span = f"{low:g} to {high:g} mean free times"
            found.append(f"diffusion coefficient: slope of the mean square displacement over 2 d, {span}")
        if not all(answer.gas.finite_horizon for answer in answers):
            found.append(
                "no diffusion coefficient where flights can be endless: the mean square displacement grows "
                "faster than time"
            )
        return [*found, "errors from the spread of the replicas"]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return a track among obstacles, how far the particle gets, and lengths of flights."""
        from studies.figures.lorentz import figure

        return figure(answers)

    def replay(self) -> Replay | None:
        """Return the particle, to be watched."""
        from studies.viewer.replay import replay_by_steps

        seed = np.random.SeedSequence(self.seed, spawn_key=(0,))
        return replay_by_steps(self.gases()[0].scene(seed), SHOWN)


def _slope(squares: FloatArray, t: FloatArray, dim: int) -> Estimate:
    """Return the diffusion coefficient from mean square displacements, (replicas, lags)."""
    low, high = (int(np.flatnonzero(LAGS == lag)[0]) for lag in WINDOW)
    return estimate_from_replicas((squares[:, high] - squares[:, low]) / (2 * dim * (t[high] - t[low])))
