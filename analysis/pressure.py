"""Pressure from the virial of collisions, from the forces on walls, and from the collision rate.

The three measure one quantity in different ways, with different noise and different assumptions, so that
their agreement is a test of the whole simulation.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.correlation_times import virial_block_length
from analysis.estimator import PALETTE, TalliedEstimator, axes_or_new, labelled, over_runs
from analysis.series import BlockSeries, equilibration
from analysis.statistics import Estimate, TheoryCheck
from analysis.theory import Prediction
from hardspheres.order import bond_order

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["Pressure", "PressureTensor"]

FloatArray = NDArray[np.float64]

FCC_ORDER = 0.2  # Q6 that a full lattice exceeds by far (0.575), and a fluid of as many spheres does not
MELTING = 0.543  # packing fraction above which spheres on a lattice stay a crystal
FLUID_UP_TO = {2: 0.66, 3: 0.494}  # packing fractions with a theory of sound


@dataclass(frozen=True)
class PressureTensor:
    """A mean pressure tensor with standard errors, [energy/length^d].

    Attributes
    ----------
    total, kinetic, collisional : (d, d) arrays
        P_ab, and its parts: momentum carried by particles between collisions, and passed in collisions.
    total_error, kinetic_error, collisional_error : (d, d) arrays
        One standard error each. Of one component; the components are correlated, since the trace of the
        kinetic part is constant.
    degrees_of_freedom, kinetic_degrees_of_freedom, collisional_degrees_of_freedom : (d, d) arrays
        Of the errors.
    """

    total: FloatArray
    kinetic: FloatArray
    collisional: FloatArray
    total_error: FloatArray
    kinetic_error: FloatArray
    collisional_error: FloatArray
    degrees_of_freedom: FloatArray
    kinetic_degrees_of_freedom: FloatArray
    collisional_degrees_of_freedom: FloatArray

    def __repr__(self) -> str:
        """Return the diagonal."""
        axes = range(len(self.total))
        return f"<PressureTensor: {', '.join(f'P_{a}{a} {self.component(a, a)}' for a in axes)}>"

    def component(
        self, a: int, b: int, part: Literal["total", "kinetic", "collisional"] = "total"
    ) -> Estimate:
        """Return one component of the whole tensor or of a part of it, [energy/length^d]."""
        freedom = "degrees_of_freedom" if part == "total" else f"{part}_degrees_of_freedom"
        names = (part, f"{part}_error", freedom)
        value, error, own = (float(getattr(self, name)[a, b]) for name in names)
        return Estimate(value, error, own + 1.0, own)


class Pressure(TalliedEstimator):
    """Pressure and compressibility factor from what the engine counts between frames.

    Give it the frames of one simulation; each two in succession make a block:

    >>> import hardspheres as hs
    >>> sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.1, seed=1))
    >>> sim.run(collisions=50 * 108)  # equilibrate
    >>> pressure = Pressure(sim.scene)
    >>> s = sim.collisions_per_particle
    >>> for frame in sim.frames(collisions_per_particle=[s + 20 * k for k in range(101)]):
    ...     pressure.add(frame)  # doctest: +SKIP
    >>> print(pressure.virial)  # doctest: +SKIP
    1.524(4)

    Z is P V / (2 K_th / d) throughout, K_th the kinetic energy without the common motion along periodic axes,
    V the volume of the box. All results are ratios of sums over blocks, with errors from blocks of automatic
    length (`series.estimate_from_series`, which also warns of too few blocks and of a drift): give 100 blocks
    or more, each of at least some collisions per particle. Blocks are no shorter than a dense fluid remembers
    (`correlation_times.virial_block_length`: 300 collisions per particle at packing fraction 0.49), which no
    short series shows. Memory does not grow beyond `series.BlockSeries`.

    Parameters
    ----------
    scene : Scene
        The gas: `sim.scene`.
    discard : bool, default False
        Drop blocks from the start by the rule of `series.equilibration`, applied to the virial per time.
    """

    def __init__(self, scene: Scene, discard: bool = False) -> None:
        super().__init__(scene, 1024, "pressure")
        self.discard = discard
        self._counts_pairs = False
        momentum = np.where(scene.periodic, scene.momentum, 0.0) if scene.n > 1 else np.zeros(scene.dim)
        self._least_block = virial_block_length(scene.packing_fraction, scene.dim)
        self._common_motion = np.outer(momentum, momentum) / float(scene.masses.sum())

    # Collecting ---------------------------------------------------------------------------------------------

    def add(self, frame: Frame) -> Self:
        """Take in what was counted since the frame before; the first frame only starts.

        Parameters
        ----------
        frame : Frame
            `sim.frame()`, or one of `sim.frames(...)`. The pressure from the rate of a mixture needs frames
            of a ``Simulation(scene, free_paths=True)``.

        Raises
        ------
        ValueError
            If the frame is of another gas or simulation, is not later than the one before, or no simulation
            made it.
        """
        tallies, kinds = self._require_next(frame), len(self._gas.sizes)
        pairs = np.zeros((kinds, kinds))
        if kinds == 1:
            pairs[0, 0] = tallies.collisions
        elif frame.free_paths is not None:
            pairs = np.triu(frame.free_paths.pair_collisions)
        counts_pairs = kinds == 1 or frame.free_paths is not None
        if self._before is not None and counts_pairs != self._counts_pairs:
            raise ValueError(
                "some of the frames have free paths and some have none; add frames of one simulation"
            )
        self._counts_pairs = counts_pairs
        kinetic = tallies.kinetic - self._common_motion * tallies.time
        parts = (tallies.virial, kinetic, tallies.wall_impulses, tallies.wall_radius_impulses, pairs)
        flat = [np.ravel(part) for part in parts]
        counted = np.concatenate([[tallies.time], *flat, [float(tallies.collisions)]])
        block = self._since_last(frame, counted)
        if block is not None:
            self._blocks.add(block)
        return self

    def _take_in(self, other: Self) -> None:
        if self._series() and other._series() and self._counts_pairs != other._counts_pairs:
            raise ValueError("one of the runs has free paths and one has none; they cannot be merged")
        self._counts_pairs |= other._counts_pairs
        super()._take_in(other)

    def _runs(self) -> list[FloatArray]:
        """Return the rows of each run without those that are discarded."""
        self._require_blocks()
        return [series.rows[self._discarded(series) :] for series in self._series()]

    @property
    def discarded_rows(self) -> int:
        """How many rows of the block series are dropped at the start; 0 unless `discard` is set."""
        return sum(map(self._discarded, self._series()))

    def _discarded(self, series: BlockSeries) -> int:
        if not self.discard or len(series) < 16:
            return 0
        rows, dim = series.rows, self.scene.dim
        trace = rows[:, 1 : 1 + dim * dim : dim + 1].sum(axis=1)
        return equilibration(trace / rows[:, 0]).start

    def _estimate(self, statistic: Callable[[FloatArray], FloatArray]) -> Estimate:
        """Return a function of the mean row, with blocks as long as the fluid is correlated."""
        runs = self._runs()
        return self._from_blocks(runs, statistic, [2.0 * rows[:, -1] for rows in runs], self._least_block)

    # Columns of a row: time, virial, kinetic, wall impulses, wall radius impulses, pairs, collisions.

    def _part(self, means: FloatArray, part: int) -> FloatArray:
        """Return one part of rows (..., p) over their time: 0 virial, 1 kinetic, 2, 3 walls, 4 pairs."""
        dim, kinds = self.scene.dim, len(self._gas.sizes)
        sizes = [(dim, dim), (dim, dim), (dim, 2), (dim, 2), (kinds, kinds)]
        first = 1 + sum(a * b for a, b in sizes[:part])
        shape = sizes[part]
        chosen = means[..., first : first + shape[0] * shape[1]] / means[..., :1]
        return np.asarray(chosen.reshape(*means.shape[:-1], *shape))

    @property
    def _thermal(self) -> float:
        """2 K_th / d = P V of the ideal gas."""
        return 2.0 * self.scene.thermal_energy / self.scene.dim

    # Virial -------------------------------------------------------------------------------------------------

    @property
    def virial(self) -> Estimate:
        """Compressibility factor from the virial, Z = 1 + W / (2 K_th), W = (1/t) sum of r.dp.

        The sum is over collisions, r the separation at contact and dp the momentum passed (Alder and
        Wainwright 1960, doi 10.1063/1.1731425). Unbiased at any length of run, N and boundary; in a periodic
        box P is what an infinite system would feel but for `theory.finite_size_compressibility`, between
        walls it is the mean over the box, with layers at the walls. Relative standard error of Z - 1: about
        1.2/sqrt(collisions).
        """
        return self._estimate(self._from_virial)

    def _from_virial(self, means: FloatArray) -> FloatArray:
        trace = np.einsum("...aa->...", self._part(means, 0))
        return np.asarray(1.0 + trace / (self.scene.dim * self._thermal))

    @property
    def virial_pressure(self) -> Estimate:
        """Pressure Z 2 K_th / (d V) of `virial`, [energy/length^d]."""
        return self._in_units_of_pressure(self.virial)

    @property
    def tensor(self) -> PressureTensor:
        """The pressure tensor, (1/V) [<sum m v_a v_b> + (1/t) sum r_a dp_b], and its two parts.

        The kinetic part is exact, an integral over time of what the engine keeps event by event, less the
        common motion along periodic axes.
        """
        parts = np.array([self._tensor(parts) for parts in ((0, 1), (1,), (0,))])
        return PressureTensor(*parts[:, 0], *parts[:, 1], *parts[:, 2])

    def _tensor(self, parts: tuple[int, ...]) -> FloatArray:
        """Value, error and degrees of freedom of a sum of tensors per volume, (3, d, d)."""
        dim = self.scene.dim
        result = np.zeros((3, dim, dim))
        for a, b in np.ndindex(dim, dim):

            def component(means: FloatArray, a: int = a, b: int = b) -> FloatArray:
                return np.asarray(
                    sum(self._part(means, part)[..., a, b] for part in parts) / self.scene.volume
                )

            estimate = self._estimate(component)
            result[:, a, b] = estimate.value, estimate.standard_error, estimate.degrees_of_freedom
        return result

    # Rate ---------------------------------------------------------------------------------------------------

    @property
    def rate(self) -> Estimate:
        """Compressibility factor from how often particles collide, `theory.compressibility_from_rate`.

        Exact at any N, density and boundary while the velocities are at equilibrium: of one species Z - 1 =
        N/(N - 1) (sigma/2d) sqrt(pi m/kT) nu C_N in a periodic box. Its noise is some 15 % lower than that of
        `virial`, since how hard each collision was is not in it. Bias: a gas that is not Maxwellian, such as
        one that is still relaxing, gives another value than `virial`; their difference is a test of that.

        Raises
        ------
        NoDataError
            For a mixture whose simulation does not tally free paths.
        """
        self._require_pairs()
        return self._estimate(self._from_rate)

    def _from_rate(self, means: FloatArray) -> FloatArray:
        freedom, temperature = self.scene.degrees_of_freedom, self.scene.temperature
        rates = self._part(means, 4)
        gas = self._gas
        return theory.compressibility_from_rate(rates, gas.diameters, gas.masses, temperature, freedom)

    def _require_pairs(self) -> None:
        self._require(
            self._counts_pairs or not self._series(),
            "rate of each pair of species",
            "add(frame) with frames of Simulation(scene, free_paths=True)",
        )

    @property
    def virial_minus_rate(self) -> Estimate:
        """Difference of the compressibility factors `virial` and `rate`, 0 in a gas at equilibrium.

        Taken block by block, since both rise and fall with the number of collisions: what is left is how hard
        they were, with a standard error of about 0.5 (Z - 1)/sqrt(collisions), less than half that of either.
        A gas that is not Maxwellian has another difference, at any density and whatever theory says of Z.

        Raises
        ------
        NoDataError
            For a mixture whose simulation does not tally free paths.
        """
        self._require_pairs()
        return self._estimate(lambda means: self._from_virial(means) - self._from_rate(means))

    @property
    def rate_pressure(self) -> Estimate:
        """Pressure Z 2 K_th / (d V) of `rate`, [energy/length^d]."""
        return self._in_units_of_pressure(self.rate)

    @property
    def collision_rate(self) -> Estimate:
        """Collisions per particle and time, nu = 2 collisions / (N t), all species together, [1/time]."""
        self._require_pairs()
        n = self.scene.n
        return self._estimate(lambda means: 2.0 / n * self._part(means, 4).sum(axis=(-2, -1)))

    # Walls --------------------------------------------------------------------------------------------------

    def _require_walls(self) -> NDArray[np.intp]:
        axes = np.flatnonzero(~self.scene.periodic)
        self._require(bool(len(axes)), "walls", "Pressure(scene) with a scene between walls")
        return axes

    def _inside(self, axes: NDArray[np.intp]) -> Estimate:
        """Return the sum over axes of P_kk V from inside, kinetic and virial part."""

        def along(means: FloatArray) -> FloatArray:
            both = self._part(means, 0) + self._part(means, 1)
            return np.asarray(both[..., axes, axes].sum(axis=-1))

        return self._estimate(along)

    def _durations(self) -> list[float]:
        """Return how long each run was measured, [time]."""
        together = zip(self._runs(), self._series(), strict=True)
        return [float(rows[:, 0].sum()) * series.samples_per_row for rows, series in together]

    def _mean_row(self) -> FloatArray:
        """Return the mean of the rows that are not discarded."""
        frames = [series.n_samples for series in self._series()]
        return over_runs([rows.mean(axis=0) for rows in self._runs()], frames)

    def _end_terms(self, axis: int) -> tuple[float, float]:
        """Return how much the two ends of all runs add to their time-integrated forces along a wall axis.

        Standard deviations of G(t) - G(0), G = sum of m x v from the middle of the box, and of the momentum
        P(t) - P(0): each 2 (1 - C(t)) times the variance at equilibrium, sum of m kT <x^2> and of m kT, where
        <x^2> = (L - 2R)^2/12 but for layers. C(t), what is left of them, counts in runs that sound crosses a
        few times only: `theory.virial_correlation` and `theory.momentum_correlation`, of a mixture as of one
        species with its mean mass and volume.
        """
        scene, times = self.scene, self._durations()
        square = (scene.box[axis] - 2.0 * scene.radii) ** 2 / 12.0
        carried = 2.0 * scene.temperature * scene.masses
        dim, mass = scene.dim, float(scene.masses.mean())
        eta = min(scene.packing_fraction, FLUID_UP_TO[dim])
        diameter = 2.0 * float((scene.radii**dim).mean() ** (1.0 / dim))
        speed = float(theory.sound_speed(eta, dim, mass, scene.temperature).value)
        damping = float(theory.sound_damping(eta, dim, diameter, mass, scene.temperature).value)
        width = float(scene.box[axis] - 2.0 * scene.radii.mean())
        moved = sum(1.0 - theory.virial_correlation(t, width, speed, damping) for t in times)
        turned = sum(1.0 - theory.momentum_correlation(t, width, speed, damping) for t in times)
        return math.sqrt(moved * float(carried @ square)), math.sqrt(turned * float(carried.sum()))

    @property
    def wall_forces(self) -> dict[str, Estimate]:
        """Mean force on each wall, by its name ("x low", "x high", ...), [energy/length].

        F = (1/t) sum of 2 m |v_n| over hits. The two walls of an axis differ by what the momentum changed
        over the run, divided by its time; that change is part of the error, see `walls`.
        """
        axes, mean = self._require_walls(), self._mean_row()
        forces, duration = {}, sum(self._durations())
        for axis in axes:
            inside = self._inside(np.array([axis]))
            impulses, moments = self._part(mean, 2)[axis], self._part(mean, 3)[axis]
            hit = impulses.sum() > 0.0
            reach = float(self.scene.box[axis]) - (2.0 * moments.sum() / impulses.sum() if hit else 0.0)
            outer, carried = self._end_terms(int(axis))
            ends = math.hypot(outer / reach, carried / 2.0) / duration
            for side, name in enumerate(("low", "high")):
                estimate = _scaled(inside, 1.0 / reach)
                forces[f"{'xyz'[axis]} {name}"] = _with_ends(estimate, float(impulses[side]), ends)
        return forces

    @property
    def wall_pressures(self) -> dict[str, Estimate]:
        """Force on each wall over the area that centres can reach, [energy/length^d].

        By the contact theorem kT times the mean density of centres in contact with the wall. It differs from
        the bulk pressure by O(sigma/L); for the exact statement see `walls`. In a mixture the area is that
        reached by a particle of mean radius.
        """
        reach = self._reach()
        pressures = {}
        for name, force in self.wall_forces.items():
            area = math.prod(np.delete(reach, "xyz".index(name[0])).tolist())
            pressures[name] = _scaled(force, 1.0 / area)
        return pressures

    @property
    def walls(self) -> Estimate:
        """Compressibility factor from the forces on the walls, sum over wall axes / (axes 2 K_th/d).

        Along a wall axis k, P_kk V = (L_k/2)(F_low + F_high) - (R F)_low - (R F)_high, where each hit counts
        with its particle's radius in (R F): Clausius' virial of the walls, equal to that of `tensor` in the
        long run at any density, size and mixture. With some axes periodic, only the wall axes are in it. A
        finite run adds [G(t) - G(0)]/t, G = sum of m r.v from the middle of the box, to what is measured
        inside; `virial_identity.virial_identity` is the identity with it. Blocks cannot tell its size, since
        one gives what the next one takes: the error combines that of the inside, from blocks, with the exact
        variance of G at equilibrium and what a run shorter than some sound waves leaves of it (the error is
        right to some 5 % there; without, it would be up to a fifth too small in a run of half a wave).
        """
        axes, half = self._require_walls(), self.scene.box / 2.0
        mean = self._mean_row()
        force, moment = self._part(mean, 2).sum(axis=-1), self._part(mean, 3).sum(axis=-1)
        scale = len(axes) * self._thermal
        value = float((half * force - moment)[axes].sum()) / scale
        ends = math.hypot(*(self._end_terms(int(axis))[0] for axis in axes)) / sum(self._durations())
        return _with_ends(_scaled(self._inside(axes), 1.0 / scale), value, ends / scale)

    @property
    def walls_pressure(self) -> Estimate:
        """Pressure Z 2 K_th / (d V) of `walls`, [energy/length^d]."""
        return self._in_units_of_pressure(self.walls)

    # Theory -------------------------------------------------------------------------------------------------

    def _in_units_of_pressure(self, z: Estimate) -> Estimate:
        return _scaled(z, self._thermal / self.scene.volume)

    @property
    def predictions(self) -> dict[str, Prediction]:
        """What the theories say of Z for this gas, the best one first, by name.

        One diameter in a periodic box: all with the finite-size correction of `theory.finite_size_shift`,
        the same for each. A mixture: Santos, Yuste and Lopez de Haro, its pairs counted one by one
        (`theory.pairs_of_few`), with the shift of one species at the same packing fraction, all of it counted
        as uncertainty. Between walls: the bulk, with an uncertainty of what it would change to take the
        volume that centres can reach for V. Spheres that start above melting as an fcc crystal without
        vacancies: that crystal. NaN where the theory ends.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", theory.TheoryRangeWarning)  # the checks say it
            return self._predictions()

    def _predictions(self) -> dict[str, Prediction]:
        scene = self.scene
        eta, dim, n = scene.packing_fraction, scene.dim, scene.n
        alike = np.ptp(self._gas.diameters) == 0.0
        if dim == 3 and alike and eta > MELTING and _is_full_lattice(scene):
            solid = theory.fcc_crystal(eta)
            z = float(solid.value)  # 500 spheres: off by 0.1(2) Z/N
            return {"fcc crystal, Schultz-Kofke": Prediction(z, math.hypot(solid.uncertainty, 0.5 * z / n))}
        bulk = theory.compressibility_factor(eta, dim)
        shift, doubt = 0.0, 0.0
        if scene.periodic.all() and n > 1:
            edge = float(scene.box.min() / 2.0 / scene.radii.mean())
            finite = theory.finite_size_shift(eta, dim, n, edge=edge)
            shift, doubt = float(finite.value), float(finite.uncertainty)
        else:
            denser = self._density_between_walls()
            doubt = abs(float(theory.compressibility_factor(denser, dim).value - bulk.value))
        if not alike:  # masses alone play no part
            sizes, diameters = self._gas.sizes, self._gas.diameters
            mixed = theory.mixture_compressibility(sizes / scene.volume, diameters, dim)
            few = 1.0
            if scene.periodic.all():
                few = theory.pairs_of_few(sizes, diameters, scene.volume, dim)
            value = 1.0 + few * (float(mixed.value) - 1.0) + shift
            both = math.hypot(mixed.uncertainty, shift, doubt)
            return {"Santos-Yuste-Lopez de Haro": Prediction(value, both)}
        named: dict[str, Prediction] = {
            ("Kolafa-Labik-Malijevsky" if dim == 3 else "virial series resummed"): bulk
        }
        if not math.isnan(float(bulk.value)):
            classic = theory.carnahan_starling(eta) if dim == 3 else theory.henderson(eta)
            missed = abs(float(classic - bulk.value))
            named["Carnahan-Starling" if dim == 3 else "Henderson"] = Prediction(classic, missed)
        if eta <= (0.5 if dim == 3 else 0.6):
            named["virial series to B10"] = theory.virial_series(eta, dim)
        return {
            name: Prediction(float(p.value) + shift, math.hypot(float(p.uncertainty), doubt))
            for name, p in named.items()
        }

    @property
    def checks(self) -> list[TheoryCheck]:
        """Each way of measuring Z beside each theory."""
        measured = {"Z from the virial": self.virial}
        if self._counts_pairs:
            measured["Z from the collision rate"] = self.rate
        if not self.scene.periodic.all():
            measured["Z from the walls"] = self.walls
        return [
            TheoryCheck(quantity, name, estimate, p.value, p.uncertainty)
            for quantity, estimate in measured.items()
            for name, p in self.predictions.items()
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw Z from each way of measuring it, with standard errors, over the theories with their bands."""
        checks = self.checks
        axes = axes_or_new(ax)
        for index, (name, prediction) in enumerate(self.predictions.items()):
            axes.axhline(prediction.value, color=PALETTE[(index + 1) % len(PALETTE)], lw=1.5, label=name)
            low, high = prediction.value - prediction.uncertainty, prediction.value + prediction.uncertainty
            axes.axhspan(low, high, color=PALETTE[(index + 1) % len(PALETTE)], alpha=0.2, lw=0)
        measured = {check.quantity: check.measured for check in checks}
        names = [quantity.removeprefix("Z from the ") for quantity in measured]
        values = [estimate.value for estimate in measured.values()]
        errors = [estimate.standard_error for estimate in measured.values()]
        axes.errorbar(range(len(names)), values, errors, fmt="o", color=PALETTE[0], label="simulation")
        axes.set_xticks(range(len(names)), names)
        axes.set_xlim(-0.5, len(names) - 0.5)
        return labelled(axes, "measured from the", "compressibility factor Z")


def _is_full_lattice(scene: Scene) -> bool:
    """Whether a scene is a face-centred cubic crystal that fills a periodic cube, without vacancies."""
    cells = round((scene.n / 4) ** (1 / 3))
    cube = bool(scene.periodic.all()) and float(np.ptp(scene.box)) <= 1e-9 * float(scene.box[0])
    return cube and 4 * cells**3 == scene.n and scene.n >= 32 and bond_order(scene).value > FCC_ORDER


def _scaled(estimate: Estimate, factor: float) -> Estimate:
    return Estimate(
        estimate.value * factor,
        estimate.standard_error * abs(factor),
        estimate.n_effective,
        estimate.degrees_of_freedom,
    )


def _with_ends(inside: Estimate, value: float, ends: float) -> Estimate:
    """Return a force with the error of the same seen from inside and, known, that of the ends of the run."""
    error = math.hypot(inside.standard_error, ends)
    share = inside.standard_error**2 / error**2 if error > 0.0 else 1.0
    freedom = inside.degrees_of_freedom / share**2 if share > 0.0 else math.inf
    return Estimate(value, error, inside.n_effective, freedom)
