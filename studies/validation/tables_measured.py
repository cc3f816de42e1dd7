"""What the accuracy tables measure: existing studies and estimators, where good numbers are known."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import hardspheres as hs
from analysis import theory
from analysis.lyapunov import lyapunov_exponent
from analysis.statistics import Estimate, TheoryCheck, estimate_from_replicas
from analysis.structure import PairDistribution
from studies.answer import Answer
from studies.diffusion import SelfDiffusion
from studies.fluid import Fluid, collisions_at, representatives
from studies.free_path import FreePaths
from studies.pressure import EquationOfState
from studies.report import Screen
from studies.study import Study, run_study
from studies.thermalisation import RelaxingGas, Thermalisation
from studies.two_starts import Discs, canonical_pressure
from studies.validation.hard_cases.exactly_solved import in_equilibrium

__all__ = ["MEASURED", "QUICK", "Crystal", "Measured", "measure"]

LI = "Li et al. 2022, N = 870"
KLM = "Kolafa et al. 2004, for N"
DYNAMO = "DynamO, N = 1372 to 530 604"
NEAR_REFERENCE = "DynamO (N to 2e6): 2.4e-6 from it"  # that far at most, at packing fractions to 0.471
ANISOTROPY = 0.2  # of the start: Tx/T - 1, as in the simulations behind its theory
APART = 5.0  # collisions per particle between two frames of `contact`

Checks = tuple[list[TheoryCheck], int]
"""Measured numbers beside their references, and the collisions that they took."""


@dataclass(frozen=True)
class Crystal(Discs):
    """Discs that start on a triangular lattice, whole in the box 29 : 30 sqrt(3)/2, and melt.

    Attributes
    ----------
    melting : float
        Collisions per particle to discard.
    """

    starts: tuple[str, ...] = ("crystal",)
    melting: float = 20_000.0

    @property
    def discarded(self) -> float:
        """Collisions per particle to discard before any measurement."""
        return self.melting


@dataclass(frozen=True, kw_only=True)
class _Pressure(EquationOfState):
    """The equation of state of one given fluid."""

    fluid: Fluid

    def gases(self) -> list[Fluid]:
        """Return this fluid."""
        return [self.fluid]


class _Silent(Screen):
    """A screen that shows nothing: that of the tables shows progress."""

    @contextlib.contextmanager
    def progress(self, text: str, total: int) -> Iterator[Callable[[], None]]:
        yield lambda: None


@dataclass(frozen=True)
class Measured:
    """Something to measure, in rounds of independent runs.

    Attributes
    ----------
    state : str
        The gas, in words.
    checks : callable
        Takes a seed; returns numbers beside their references, and how many collisions they took.
    every : int
        In which rounds: 0 and the multiples of this.
    others : str
        What other programs give.
    load : callable
        Compiles what it needs.
    """

    state: str
    checks: Callable[[int], Checks]
    every: int = 1
    others: str = ""
    load: Callable[[], object] = lambda: None


def measure(item: tuple[str, int], table: Mapping[str, Measured], root: int) -> Checks:
    """Return what one round of a measurement gives.

    Parameters
    ----------
    item : (str, int)
        Name of the measurement, and the round.
    table : mapping
        `MEASURED` or `QUICK`.
    root : int
        Seed of all.
    """
    name, number = item
    words = [root, *name.encode(), number]
    return table[name].checks(int(np.random.SeedSequence(words).generate_state(1)[0]))


def _of_study(
    make: Callable[[int], Study],
    pick: Callable[[Answer], Sequence[TheoryCheck]],
    state: str,
    every: int = 1,
    others: str = "",
) -> Measured:
    """Return the measurement that conducts a study; broken invariants are an error."""

    def checks(seed: int) -> Checks:
        study = make(seed)
        ((gas, runs),) = zip(study.gases(), run_study(study, _Silent(json_output=True))[0], strict=True)
        if broken := [run.failure for run in runs if run.failure]:
            raise hs.SimulationError(f"{state}: {broken[0]}")
        return list(pick(study.answer(gas, runs))), sum(run.status["collisions"] for run in runs)

    def load() -> None:
        study = make(0)
        for gas in representatives(study.gases()):
            study.start(gas, np.random.SeedSequence(0)).run(collisions=1)

    return Measured(state, checks, every, others, load)


# Pressure -----------------------------------------------------------------------------------------------


def _spheres(eta: float, length: float, n: int = 4000, others: str = NEAR_REFERENCE) -> Measured:
    """Return Z of spheres beside its reference; `length` in collisions per particle."""

    def make(seed: int) -> Study:
        return _Pressure(
            fluid=Fluid(n, 3, eta), collisions_per_particle=length, replicas=1, seed=seed, workers=1
        )

    def pick(answer: Answer) -> list[TheoryCheck]:
        z = theory.finite_size_compressibility(eta, 3, n)
        return [
            TheoryCheck(f"Z, {way}", KLM, answer[name].measured, float(z.value), float(z.uncertainty))
            for way, name in (("virial", "Z from the virial"), ("rate", "Z from the rate"))
        ]

    return _of_study(make, pick, f"{n} spheres, 3D, {eta:g}", others=others)


def _discs(fluid: Fluid, length: float, expected: tuple[float, float], box: str) -> Measured:
    """Return the pressure of discs beside event-chain Monte Carlo; `length` in collisions per particle."""

    def make(seed: int) -> Study:
        return _Pressure(fluid=fluid, collisions_per_particle=length, replicas=1, seed=seed, workers=1)

    def pick(answer: Answer) -> list[TheoryCheck]:
        return [
            TheoryCheck(
                f"P sigma^2/kT, {way}",
                LI,
                canonical_pressure(answer[name].measured, fluid.packing_fraction, fluid.n),
                *expected,
            )
            for way, name in (("virial", "Z from the virial"), ("rate", "Z from the rate"))
        ]

    return _of_study(make, pick, f"{fluid.n} discs, {box}, {fluid.packing_fraction:g}")


def _contact(eta: float, n: int, frames: int, every: int) -> Measured:
    """Return g at contact, extrapolated from the pair distribution; the reference by the contact theorem."""

    def checks(seed: int) -> Checks:
        fluid, pairs = Fluid(n, 3, eta), PairDistribution()
        simulation = hs.Simulation(fluid.scene(np.random.SeedSequence(seed)))
        fluid.settle(simulation)
        apart = APART / float(theory.collision_rate(eta, 3))
        for _ in range(frames):
            simulation.run(time=apart)
            pairs.add(simulation.frame())
        z = theory.finite_size_compressibility(eta, 3, n, "canonical")
        expected = float(z.value - 1.0) / (4.0 * eta), float(z.uncertainty) / (4.0 * eta)
        return [TheoryCheck("g at contact", KLM, pairs.contact[0, 0], *expected)], simulation.collisions

    return Measured(f"{n} spheres, 3D, {eta:g}", checks, every)


# Flights, relaxation, transport -------------------------------------------------------------------------


def _flights(dim: int, eta: float, length: float, n: int, every: int, moments: bool) -> Measured:
    """Return mean free path and time, and moments of all flights where the gas is dilute."""

    def make(seed: int) -> Study:
        more = {"collisions_per_particle": length, "replicas": 1, "seed": seed, "workers": 1}
        return FreePaths(packing_fractions=(eta,), n=n, dim=dim, **more)  # type: ignore[arg-type]

    def pick(answer: Answer) -> list[TheoryCheck]:
        kept = ("mean", "<") if moments else ("mean",)
        return [check for check in answer.numbers if check.quantity.startswith(kept)]

    return _of_study(make, pick, f"{n} {'discs, 2D' if dim == 2 else 'spheres, 3D'}, {eta:g}", every)


DILUTE = 0.001  # packing fraction of gases beside the Boltzmann equation


@dataclass(frozen=True)
class Stretched(RelaxingGas):
    """A Maxwellian gas whose temperature along x is, exactly, 1 + `ANISOTROPY` of the mean."""

    def scene(self, seed: np.random.SeedSequence) -> hs.Scene:
        """Return the start that belongs to a seed."""
        scene = super().scene(seed)
        along = (scene.velocities**2).mean(axis=0)
        share = np.full(self.dim, 1.0 - ANISOTROPY / (self.dim - 1))
        share[0] = 1.0 + ANISOTROPY
        return scene.replace(velocities=scene.velocities * np.sqrt(share * along.mean() / along))


@dataclass(frozen=True, kw_only=True)
class _Anisotropy(Thermalisation):
    """The relaxation of a stretched gas."""

    def gases(self) -> list[RelaxingGas]:
        """Return it."""
        return [Stretched(self.n or 0, self.dim or 0, DILUTE, velocities="maxwell")]


def _relaxation(
    dim: int, moments: tuple[float, ...], n: int, replicas: int, every: int, of_axes: bool = False
) -> Measured:
    """Return a2 after equal speeds, or the decay of an anisotropy, at these s of a dilute gas."""

    def make(seed: int) -> Study:
        return (_Anisotropy if of_axes else Thermalisation)(
            dim=dim,
            n=n,
            packing_fraction=DILUTE,
            collisions_per_particle=max(moments),
            frames=0,
            replicas=replicas,
            seed=seed,
            workers=1,
        )

    def pick(answer: Answer) -> list[TheoryCheck]:
        curve = answer.hidden["curve"]
        if of_axes:
            tx, error = curve.temperature_along(np.eye(dim)[0])
            name, value, error = "decay of Tx/T - 1", (tx - 1.0) / ANISOTROPY, error / ANISOTROPY
            known = theory.anisotropy_decay(curve.s, dim)
            expected, uncertainty = known.value, known.uncertainty
        else:
            reference, name = answer.hidden["reference"], "a2 after equal speeds"
            value, error = curve.a2, curve.a2_error
            expected, uncertainty = reference.a2, reference.a2_uncertainty
        points = [curve.s.tolist().index(moment) for moment in moments]
        return [
            TheoryCheck(
                f"{name}, s = {curve.s[k]:g}",
                "Boltzmann equation",
                Estimate(float(value[k]), float(error[k]), replicas, replicas - 1.0),
                float(expected[k]),
                float(uncertainty[k]),
            )
            for k in points
        ]

    state = f"{replicas} x {n} {'discs, 2D' if dim == 2 else 'spheres, 3D'}, {DILUTE:g}"
    return _of_study(make, pick, state, every)


def _diffusion(
    rho: float, n: int, replicas: int, infinite: tuple[float, float], every: int, others: str
) -> Measured:
    """Return D in a box beside DynamO's D of the infinite fluid, less the correction for this box."""

    def make(seed: int) -> Study:
        eta = math.pi * rho / 6.0
        return SelfDiffusion(packing_fractions=(eta,), n=n, replicas=replicas, seed=seed, workers=1)

    def pick(answer: Answer) -> list[TheoryCheck]:
        lacking = answer["correction for the box"].measured
        expected = infinite[0] - lacking.value, math.hypot(infinite[1], lacking.standard_error)
        return [TheoryCheck("D of the box", DYNAMO, answer["D of this box"].measured, *expected)]

    return _of_study(make, pick, f"{replicas} x {n} spheres, 3D, {math.pi * rho / 6:.4f}", every, others)


# Exact, and chaotic -------------------------------------------------------------------------------------


def _two_in_a_box(box: tuple[float, ...], time: float, runs: int, every: int) -> Measured:
    """Return the rates of two discs or spheres between hard walls, from the microcanonical ensemble."""

    def checks(seed: int) -> Checks:
        rng, rates, collisions = np.random.default_rng(seed), [], 0
        for _ in range(runs):
            simulation = hs.Simulation(in_equilibrium(box, rng))
            simulation.run(time=time)
            rates.append((simulation.collisions / time, simulation.wall_collisions / time))
            collisions += simulation.collisions + simulation.wall_collisions
        exact = theory.two_sphere_rates(box)
        truths = (exact.pair, float(exact.wall.sum()))
        measured = [estimate_from_replicas(each) for each in np.transpose(rates)]
        return [
            TheoryCheck(f"{what} rate", "exact", estimate, truth, 0.0)
            for what, estimate, truth in zip(("pair", "wall"), measured, truths, strict=True)
        ], collisions

    def load() -> None:
        hs.Simulation(in_equilibrium(box, np.random.default_rng(0))).run(collisions=1)

    what = f"2 {'discs' if len(box) == 2 else 'spheres'}, hard box {' x '.join(f'{e:g}' for e in box)}"
    return Measured(what, checks, every, load=load)


def _lyapunov(eta: float, n: int, expected: tuple[float, float], length: float, every: int) -> Measured:
    """Return the largest Lyapunov exponent beside an independent program's; few digits are known."""

    def checks(seed: int) -> Checks:
        scene, settle = hs.random_gas(n=n, packing_fraction=eta, seed=seed), 20.0
        measured = lyapunov_exponent(scene, length, settle).per_collision
        check = TheoryCheck("Lyapunov exponent, per s", "independent program", measured, *expected)
        return [check], collisions_at(settle + length, n)

    return Measured(f"{n} spheres, 3D, {eta:g}", checks, every)


ROOT3 = "box 29 : 30 sqrt(3)/2"
MEASURED: dict[str, Measured] = {
    "spheres, 0.1": _spheres(0.1, 3000.0),
    "spheres, 0.3": _spheres(0.3, 15_000.0),
    "spheres, 0.45": _spheres(0.45, 22_000.0),
    "discs, 0.67": _discs(Fluid(870, 2, 0.67), 200_000.0, (7.986779, 25e-6), "square box"),
    "discs, 0.67, melted": _discs(
        Crystal(packing_fraction=0.67), 200_000.0, (7.986735, 26e-6), f"melted, {ROOT3}"
    ),
    "discs, 0.69": _discs(Fluid(870, 2, 0.69), 300_000.0, (8.969898, 75e-6), "square box"),
    "discs, 0.69, melted": _discs(
        Crystal(packing_fraction=0.69), 300_000.0, (8.969476, 97e-6), f"melted, {ROOT3}"
    ),
    "contact, 0.3": _contact(0.3, 4000, 300, 5),
    "flights, 3D": _flights(3, 1e-4, 500.0, 16_000, 5, moments=True),
    "flights, 2D": _flights(2, 1e-4, 500.0, 16_000, 5, moments=True),
    "flights, 0.3": _flights(3, 0.3, 5000.0, 4000, 5, moments=False),
    "a2, 3D": _relaxation(3, (1.0, 2.0, 4.0), 16_000, 100, 5),
    "a2, 2D": _relaxation(2, (1.0, 2.0, 4.0), 16_000, 100, 5),
    "anisotropy, 3D": _relaxation(3, (1.0, 2.0), 16_000, 100, 5, of_axes=True),
    "anisotropy, 2D": _relaxation(2, (1.0, 2.0), 16_000, 100, 5, of_axes=True),
    "diffusion, rho 0.3": _diffusion(0.3, 1372, 12, (0.5554, 0.0003), 5, "in such a box .5350(9)"),
    "diffusion, rho 0.7": _diffusion(0.7, 1372, 12, (0.1210, 0.0003), 5, "in such a box .1124(2)"),
    "two discs": _two_in_a_box((2.7, 3.6), 200.0, 2000, 5),
    "two spheres": _two_in_a_box((2.6, 3.1, 3.7), 200.0, 2000, 5),
    "Lyapunov, 0.01": _lyapunov(0.01, 125, (6.15, 0.03), 200.0, 5),
}
"""By name: the name is part of the seed."""

QUICK: dict[str, Measured] = {
    "spheres": _spheres(0.2, 100.0, n=108, others=""),
    "melted": _discs(Crystal(packing_fraction=0.60, melting=50.0), 80.0, (4.933, 0.05), ROOT3),
    "contact": _contact(0.1, 108, 40, 2),
    "flights": _flights(3, 0.01, 40.0, 100, 2, moments=True),
    "a2": _relaxation(3, (1.0, 2.0), 100, 12, 1),
    "anisotropy": _relaxation(3, (1.0,), 400, 40, 2, of_axes=True),
    "Lyapunov": _lyapunov(0.2, 32, (0.95, 0.1), 16.0, 2),
}
"""Tiny gases, to test the machinery."""
