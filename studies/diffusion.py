"""Self-diffusion: mean square displacement, velocity autocorrelation and D, beside Enskog's theory."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.series import SeriesWarning
from analysis.statistics import Estimate, estimate_from_replicas, replica_mean
from analysis.transport import Diffusion, with_correction
from studies import real_fluid
from studies.answer import Answer, Column, Curves, alarms, number
from studies.fluid import Fluid, check_length, check_spread, ordered
from studies.options import densities, dimension, option, packing_fractions, particles, runs
from studies.real_fluid import RealFluid, real_gas_of
from studies.running.resuming import until
from studies.study import Replica, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["SelfDiffusion", "Slope"]

FloatArray = NDArray[np.float64]

USUAL_DENSITIES = "0.1,0.3"
SPACING = 0.25  # of the sampled times, in mean free times
POINTS = 16  # snapshots per level of `Diffusion`
# collisions per particle with this spacing, then for the slope alone; fewer where there are more particles
DENSE, FEWEST_DENSE, DENSE_PARTICLES = 100.0, 30.0, 4000
SLOPE_POINTS = 12  # snapshots for the slope: its window ends at the last
DISCS = (20.0, 40.0)  # lags between which the slope is taken in 2D, in mean free times
SHORTEST = 80.0  # collisions per particle
USUAL, LONGEST_BY_DEFAULT = 200.0, 2000.0  # collisions per particle where none are asked for


@dataclass(frozen=True)
class Slope:
    """Window of the slope of the mean square displacement, and length of the run, in mean free times.

    Attributes
    ----------
    needed : (float, float)
        The window for D of the box: `theory.periodic_diffusion_window`, 20 to 40 in 2D.
    length : float
        Of the measurement.
    dense : float
        Part of it in which samples are SPACING apart, for the curves.
    """

    needed: tuple[float, float]
    length: float
    dense: float = DENSE

    @classmethod
    def of(cls, fluid: Fluid, length: float | None) -> Slope:
        """Return the slope for a fluid: by default a run of three windows, at least 200 and at most 2000."""
        needed = DISCS
        if fluid.dim == 3:
            sphere = float(theory.packing_fraction(1.0, fluid.units["diameter"], 3))
            edge = (fluid.n / (fluid.packing_fraction / sphere)) ** (1 / 3)
            begin, end = theory.periodic_diffusion_window(fluid.packing_fraction, edge, **fluid.units)
            needed = (begin / _mean_free_time(fluid), end / _mean_free_time(fluid))
        dense = max(DENSE * min(1.0, DENSE_PARTICLES / fluid.n), FEWEST_DENSE)
        return cls(needed, length or min(max(USUAL, 3.0 * needed[1]), LONGEST_BY_DEFAULT), dense)

    @property
    def short(self) -> bool:
        """Whether the measurement is shorter than two windows."""
        return self.needed[1] > self.length / 2.0 * (1.0 + 1e-9)

    @property
    def stride(self) -> int:
        """Sample spacings between two samples of the slope."""
        return max(math.floor(min(self.needed[1], self.length / 2.0) / SLOPE_POINTS / SPACING + 0.5), 1)

    @property
    def window(self) -> tuple[float, float]:
        """Lags between which the slope is taken."""
        end = SLOPE_POINTS * self.stride
        return SPACING * round(
            end * self.needed[0] / self.needed[1] / self.stride
        ) * self.stride, SPACING * end

    @property
    def moments(self) -> list[int]:
        """Sample times, in units of SPACING."""
        last = math.ceil(self.length / SPACING)
        dense = range(min(last, round(self.dense / SPACING)) + 1)
        return sorted({*dense, *range(0, last + 1, self.stride)})

    @property
    def note(self) -> str | None:
        """Note on a short measurement."""
        if not self.short:
            return None
        begin, end = self.window
        return (
            f"too short for D of this box, the slope from {self.needed[0]:.0f} to {self.needed[1]:.0f} mean "
            f"free times: it is that from {begin:.0f} to {end:.0f}, and theory supplies the rest of the "
            f"tail; ask for --collisions-per-particle {math.ceil(2.0 * self.needed[1])}"
        )


def _mean_free_time(fluid: Fluid) -> float:
    return 1.0 / float(theory.collision_rate(fluid.packing_fraction, fluid.dim, **fluid.units))


@dataclass(frozen=True, kw_only=True)
class SelfDiffusion(Study):
    """Displacements of particles in a periodic box, and D of this box and of the infinite fluid."""

    name = "diffusion"
    question = "How fast do particles diffuse in the infinite fluid?"
    explanation = """
    Mean square displacement and velocity autocorrelation against time, and D from the slope of the first with
    the correction for the periodic box. Writes a summary, two tables and a picture.
    """
    table = "diffusion"
    files = ("diffusion.csv", "correlations.csv", "diffusion.png")

    packing_fractions: tuple[float, ...] | None = densities(USUAL_DENSITIES, asked=True)
    gas: str | None = real_fluid.gas()
    temperature: float | None = real_fluid.temperature()
    pressure: float | None = real_fluid.pressure()
    diameter: str | float | None = real_fluid.diameter()
    n: int = particles(1000)
    dim: int = dimension()
    collisions_per_particle: float | None = option(
        None,
        "How long to measure in each replica, s = 2 collisions / n.",
        shown="three times the window of the slope, 200 to 2000",
    )
    replicas: int = runs(12)

    def gases(self) -> list[Fluid]:
        """Return the gases to measure, by ascending packing fraction."""
        etas = self.packing_fractions or packing_fractions(USUAL_DENSITIES)
        fluids = [Fluid(self.n, self.dim, eta) for eta in etas]
        if (real := real_gas_of(self)) is not None:
            fluids = [RealFluid.of(self.n, real)]
        for fluid in fluids:
            fluid.check_within("Enskog's theory")
        if self.collisions_per_particle is not None:
            check_length(self.collisions_per_particle, SHORTEST, "is no length for a slope")
        check_spread(self.replicas)
        return fluids

    def slope(self, gas: Fluid) -> Slope:
        """Return where the slope is taken."""
        return Slope.of(gas, self.collisions_per_particle)

    def estimators(self, gas: Fluid, simulation: hs.Simulation) -> dict[str, Any]:
        """Return one for close times and one for those of the slope."""
        return {"near": Diffusion(POINTS), "far": Diffusion(SLOPE_POINTS)}

    def advance(self, gas: Fluid, replica: Replica) -> Iterator[None]:
        """Equilibrate, then sample at equally spaced times: close ones, then those of the slope."""
        simulation, slope = replica.simulation, self.slope(gas)
        near, far = replica.estimators["near"], replica.estimators["far"]
        yield from until(simulation, gas.settled)
        moments = slope.moments
        for k in range(replica.done, len(moments)):
            if k > 0:
                simulation.run(time=(moments[k] - moments[k - 1]) * SPACING * _mean_free_time(gas))
            if moments[k] <= slope.dense / SPACING:
                near.add(simulation)
            if moments[k] % slope.stride == 0:
                far.add(simulation)
            replica.done += 1
            yield
        replica.seen["ordered"] = ordered(simulation)

    def answer(self, gas: Fluid, replicas: Sequence[Replica]) -> Answer:
        """Return D, and both correlation functions, with errors from the spread of the replicas."""
        slope, rate = self.slope(gas), 1.0 / _mean_free_time(gas)
        window = (slope.window[0] / rate, slope.window[1] / rate)
        far = [replica.estimators["far"] for replica in replicas]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)  # the error comes from the replicas
            here = estimate_from_replicas([one.diffusion(window).value for one in far])
        enskog = theory.enskog_diffusion(gas.packing_fraction, gas.dim, **gas.units)
        if gas.dim == 3:
            edge = float(far[0].scene.box[0])
            correction = theory.periodic_diffusion_correction(
                gas.packing_fraction, edge, **gas.units, window=window
            )
            infinite = with_correction(here, correction)
            numbers = [
                number("D of this box", here),
                number(
                    "correction for the box", Estimate(float(correction.value), float(correction.uncertainty))
                ),
                number("D", infinite, "Enskog", enskog),
            ]
        else:
            numbers = [number("D of this box", here, "Enskog", enskog)]
        numbers = gas.in_units(numbers)
        failures = alarms(numbers)
        if any(replica.seen["ordered"] for replica in replicas):
            failures.append("the particles have ordered: this is no fluid")
        return Answer(
            gas,
            numbers,
            {"correlations": _correlations(gas, replicas, rate)},
            [*gas.remarks, *([slope.note] if slope.note else [])],
            failures,
            details={
                "discarded_collisions_per_particle": gas.discarded,
                "collisions_per_particle": slope.length,
                "window_in_mean_free_times": slope.window,
            },
        )

    def legend(self, answers: Sequence[Answer]) -> list[str]:
        """Return what the numbers are."""
        windows = [answer.details["window_in_mean_free_times"] for answer in answers]
        taken = "; ".join(f"{begin:.0f} to {end:.0f}" for begin, end in dict.fromkeys(windows))
        discarded = ", ".join(f"{s:.0f}" for s in dict.fromkeys(answer.gas.discarded for answer in answers))
        box = (
            "in 2D diffusion has no infinite limit: D grows as the logarithm of the box"
            if self.dim == 2
            else "correction: reduction of D by the periodic box (after Yeh and Hummer 2004); D, of the "
            "infinite fluid, includes it, and its uncertainty"
        )
        how = (
            f"D from the slope of the mean square displacement over {taken} mean free times, after "
            f"{discarded} discarded collisions per particle; errors from the spread of the replicas"
        )
        return [
            how,
            box,
            "Enskog's theory leaves out correlated collisions: its uncertainty is its known systematic error",
        ]

    def figure(self, answers: Sequence[Answer]) -> Figure:
        """Return displacements, velocity autocorrelation and D."""
        from studies.figures.diffusion import figure

        return figure(answers)


def _correlations(gas: Fluid, replicas: Sequence[Replica], rate: float) -> Curves:
    """Return both correlation functions of time: close lags, then those of the slope alone."""
    near, far = replicas[0].estimators["near"], replicas[0].estimators["far"]
    later = far.lags > near.lags[-1] * (1.0 + 1e-9)
    lags = np.append(near.lags, far.lags[later])

    def joined(name: str) -> tuple[FloatArray, FloatArray]:
        pairs = [(replica.estimators["near"], replica.estimators["far"]) for replica in replicas]
        return replica_mean([np.append(getattr(a, name), getattr(b, name)[later]) for a, b in pairs])

    return Curves(
        {"time": lags, "mean_free_times": lags * rate},
        {
            "mean_square_displacement": Column(*joined("mean_square_displacement")),
            "velocity_autocorrelation": Column(
                *joined("velocity_autocorrelation"), theory=np.exp(-2 / gas.dim * rate * lags)
            ),
        },
    )
