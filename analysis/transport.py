"""Diffusion: mean square displacement and velocity autocorrelation over lags spaced by powers of two.

The other transport coefficients, from tallied moments, are in `helfand`; their names are here too.
"""

from __future__ import annotations

import contextlib
import math
import warnings
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import Estimator, NoDataError, axes_or_new, counted, labelled, over_runs
from analysis.helfand import HeatConductivity, MutualDiffusion, Viscosity
from analysis.reduced import Gas
from analysis.series import BlockSeries, SeriesWarning, estimate_from_runs, estimate_from_series
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Scene

__all__ = [
    "Diffusion",
    "HeatConductivity",
    "Moving",
    "MutualDiffusion",
    "ShortWindowWarning",
    "Viscosity",
]

FloatArray = NDArray[np.float64]

WINDOWS = 32  # least length of a run, in lags, for errors from blocks of origins
GROUPS = 64  # groups of particles whose spread gives the error at longer lags


class ShortWindowWarning(UserWarning):
    """A slope was taken before momentum had spread over the box: part of the result is then from theory."""


class Moving(Protocol):
    """What `Diffusion.add` reads: a Simulation, or a frame that has unwrapped positions."""

    @property
    def time(self) -> float:
        """Simulated time."""
        ...

    @property
    def unwrapped_positions(self) -> FloatArray:
        """Positions followed through the periodic boundaries, (N, d)."""
        ...

    @property
    def velocities(self) -> FloatArray:
        """Velocities, (N, d)."""
        ...

    @property
    def scene(self) -> Scene:
        """Where the simulation started."""
        ...


class Diffusion(Estimator):
    """Mean square displacement, velocity autocorrelation and self-diffusion.

    Add the simulation (or frames with `unwrapped_positions`) at equally spaced times. Lags are 1 to `points`
    spacings, then points/2 + 1 to `points` double spacings, and so on: each level keeps its last `points`
    snapshots, so that memory grows as the logarithm of the length of the run (the scheme of Dubbeldam et al.,
    Mol. Simul. 35, 1084 (2009), doi 10.1080/08927020902818039).

    >>> diffusion = Diffusion()
    >>> for _ in range(1000):  # doctest: +SKIP
    ...     sim.run(time=0.1)
    ...     diffusion.add(sim)
    >>> print(diffusion.diffusion(window=(5.0, 10.0)))  # doctest: +SKIP

    Parameters
    ----------
    points : int, default 16
        Snapshots per level; even, at least 4.
    species : int, optional
        Only the particles of this species; all by default.
    label : int, optional
        Only the particles with this label in `Scene.labels`, such as a tracer.

    Notes
    -----
    Displacements are relative to the common motion. Each lag has one value per origin, the average over
    particles. Where the run is `WINDOWS` lags long or longer, its error comes from blocks of origins of
    automatic length (`series.estimate_from_series`); at longer lags, of which the run holds too few, from the
    spread of the particles, see `mean_square_displacement_error`.
    """

    def __init__(self, points: int = 16, species: int | None = None, label: int | None = None) -> None:
        if points < 4 or points % 2:
            raise ValueError(f"points = {points}; expected an even number of at least 4")
        self.points = points
        self.species = species
        self.label = label
        self._times: list[float] = []
        self._count = 0
        self._particles = 0
        self._scene: Scene | None = None
        self._merged: list[Diffusion] = []  # other runs
        self._levels: list[deque[tuple[FloatArray, FloatArray]]] = []
        self._rows_by_level: list[BlockSeries] = []
        self._groups_by_level: list[
            FloatArray
        ] = []  # sums over origins and the particles of a group, (2 points + 1, G)
        self._first: tuple[FloatArray, FloatArray] | None = None

    # Collecting ---------------------------------------------------------------------------------------------

    def add(self, frame: Moving) -> Self:
        """Add one sample.

        Parameters
        ----------
        frame : Simulation or frame
            Anything with `time`, `unwrapped_positions`, `velocities` and `scene`; equally spaced in time.

        Raises
        ------
        ValueError
            If it has no unwrapped positions, comes at another spacing than the others, or no particle is of
            the species and has the label.
        """
        positions = getattr(frame, "unwrapped_positions", None)
        if positions is None:
            raise ValueError("the frame has no unwrapped positions; add the simulation itself: add(sim)")
        self._check_time(float(frame.time))
        scene = frame.scene
        members = self._members(scene)
        self._particles = len(members)
        self._scene = self._scene or scene
        self._gas = self._gas or Gas.of(scene)
        share = scene.masses / scene.masses.sum()
        common = np.where(scene.periodic, 1.0, 0.0)
        x = (positions - common * (share @ positions))[members]
        v = (frame.velocities - common * (share @ frame.velocities))[members]
        level, every = 0, 1
        while self._count % every == 0:
            if level == len(self._levels):
                self._levels.append(deque(maxlen=self.points))
                self._rows_by_level.append(BlockSeries(256))
                self._groups_by_level.append(np.zeros((2 * self.points + 1, min(GROUPS, len(x)))))
            self._visit(level, x, v)
            if self._count == 0:  # the first snapshot belongs to every level
                self._first = (x, v)
                break
            level, every = level + 1, 2 * every
        self._count += 1
        return self

    @property
    def _added(self) -> str:
        return counted(sum(run._count for run in (self, *self._merged)), "moment")

    def _checked(self) -> list[str]:
        with contextlib.suppress(NoDataError):
            reach = f"lags from {self.lags[0]:.4g} to {self.lags[-1]:.4g}"
            return super()._checked() or [reach]
        return []

    @property
    def scene(self) -> Scene:
        """Where the simulation started whose gas is followed: its box, sizes and masses."""
        self._require(self._scene is not None, "moments", "add(sim)")
        assert self._scene is not None
        return self._scene

    def _take_in(self, other: Self) -> None:
        spacings = [run.spacing for run in (self, other) if len(run._times) > 1]
        if np.ptp(spacings or [0.0]) > 1e-6 * max(spacings, default=1.0):
            raise ValueError(
                f"samples {spacings[0]:g} and {spacings[1]:g} apart in time cannot be merged: the lags differ"
            )
        self._scene = self._scene or other._scene
        self._merged += [other, *other._merged]
        other._merged = []
        other._levels, other._first = [], None  # of snapshots, which only an own run needs

    def _check_time(self, time: float) -> None:
        self._times = [*self._times[:2], time]  # the first two, and the last
        if len(self._times) < 3:
            if len(self._times) == 2 and not self._times[1] > self._times[0]:
                raise ValueError(
                    f"time = {time:g} is not after {self._times[0]:g}; run between two calls of add"
                )
            return
        spacing = self._times[1] - self._times[0]
        expected = self._times[0] + self._count * spacing
        if abs(time - expected) > 1e-3 * spacing:
            raise ValueError(
                f"time = {time:g}; expected {expected:g}: moments must be equally spaced, here by {spacing:g}"
            )

    def _visit(self, level: int, x: FloatArray, v: FloatArray) -> None:
        """Correlate a snapshot with the last ones of its level, then store it there."""
        past = self._levels[level]
        if level > 0 and not past and self._first is not None:
            past.append(self._first)
        if len(past) == self.points:
            old_x = np.array([snapshot[0] for snapshot in past])[::-1]
            old_v = np.array([snapshot[1] for snapshot in past])[::-1]
            squares = ((x - old_x) ** 2).sum(axis=2)
            products = (v * old_v).sum(axis=2)
            each = np.concatenate([squares, (v * v).sum(axis=1)[None], products])
            self._rows_by_level[level].add(each.mean(axis=1))
            groups = self._groups_by_level[level]
            missing = -len(x) % groups.shape[1]
            groups += np.pad(each, ((0, 0), (0, missing))).reshape(len(each), -1, groups.shape[1]).sum(axis=1)
        past.append((x, v))

    def _members(self, scene: Scene) -> NDArray[np.intp]:
        """Particles of the species with the label."""
        chosen = np.ones(scene.n, dtype=bool)
        if self.species is not None:
            chosen = scene.species == self.species
            if not chosen.any():
                raise ValueError(f"species = {self.species}; the gas has {int(scene.species.max()) + 1}")
        if self.label is not None:
            if scene.labels is None:
                raise ValueError(f"label = {self.label}, but the particles have no labels; give Scene some")
            chosen = chosen & (scene.labels == self.label)
            if not chosen.any():
                raise ValueError(f"label = {self.label}, but no particle (of the species) has it")
        return np.flatnonzero(chosen)

    # Lags ---------------------------------------------------------------------------------------------------

    def _runs(self) -> list[Diffusion]:
        """Return all runs that have lags."""
        return [run for run in (self, *self._merged) if run._reaches(0)]

    def _reaches(self, level: int) -> bool:
        return level < len(self._rows_by_level) and len(self._rows_by_level[level]) >= 2

    @property
    def spacing(self) -> float:
        """Time between two moments, [time]."""
        times = next((run._times for run in (self, *self._merged) if len(run._times) > 1), [])
        self._require(bool(times), "spacing", "add(sim) at least twice")
        return times[1] - times[0]

    def _lags(self) -> list[tuple[int, int]]:
        """Level and place within it of every lag that has at least two origins in each run."""
        runs, lags, level = self._runs(), [], 0
        while runs and all(run._reaches(level) for run in runs):
            first = 1 if level == 0 else self.points // 2 + 1
            lags += [(level, k) for k in range(first, self.points + 1)]
            level += 1
        self._require(bool(lags), "lags", f"add(sim) at least {self.points + 2} times")
        return lags

    @property
    def lags(self) -> FloatArray:
        """Times between two moments that are compared, ascending, (lags,), [time]."""
        return np.array([k * 2.0**level for level, k in self._lags()]) * self.spacing

    def _origins(self, level: int) -> list[int]:
        return [run._rows_by_level[level].n_samples for run in self._runs()]

    def _mean(self, level: int) -> FloatArray:
        """Mean over all origins of all runs."""
        return over_runs([run._rows_by_level[level].mean for run in self._runs()], self._origins(level))

    def _pooled(self, level: int, statistic: Callable[[FloatArray], FloatArray]) -> Estimate:
        """Return the mean over origins of a number, given as a function of the rows of a level."""
        rows = [statistic(run._rows_by_level[level].rows) for run in self._runs()]
        return estimate_from_runs(rows, weights=self._origins(level))

    @property
    def mean_square_displacement(self) -> FloatArray:
        """<|x(t) - x(0)|^2> at each of `lags`, relative to the common motion, (lags,), [length^2]."""
        return np.array([self._mean(level)[k - 1] for level, k in self._lags()])

    @property
    def mean_square_displacement_error(self) -> FloatArray:
        """Standard errors of `mean_square_displacement`, (lags,).

        Where the run holds `WINDOWS` lags or more, from blocks of at least four lags each. A longer lag has
        too few independent origins for that: the error is then from the spread of `GROUPS` groups of
        particles. It accounts for overlapping origins but not for correlations between particles, which are
        taken from the longest lags that have both errors (Notes).

        Notes
        -----
        Particles share momentum with their neighbours, which makes the variance of their mean larger than
        that of as many independent ones: by the ratio of blocks to groups, its mean over the longer half of
        the lags that have both, and at least 1. Over 60 to 200 runs each of 32 to 108 spheres at packing
        fractions 0.01 to 0.3 the deviations from the mean of all runs spread 0.8 to 1.3 times as far as these
        errors, at every lag up to half of the run and beyond; but in short runs of a dilute gas, at lags of 1
        to 4 mean free times, where the fixed energy reduces fluctuations of the mean, the errors are up to
        twice too large.
        """
        return self._errors(-1)

    @property
    def velocity_autocorrelation(self) -> FloatArray:
        """<v(0).v(t)>/<v^2> at each of `lags`, (lags,)."""
        rows = [(self._mean(level), self.points + k) for level, k in self._lags()]
        return np.array([mean[place] / mean[self.points] for mean, place in rows])

    @property
    def velocity_autocorrelation_error(self) -> FloatArray:
        """Standard errors of `velocity_autocorrelation`, (lags,), as `mean_square_displacement_error`."""
        return self._errors(self.points, self.points)

    def _errors(self, shift: int, over: int | None = None) -> FloatArray:
        """Errors of the columns shift + k of all lags, or of their ratios to column `over`; of all runs."""
        lags, runs = self._lags(), self._runs()
        errors = np.array([run._own_errors(lags, shift, over) for run in runs])
        weights = np.array([self._origins(level) for level, _ in lags]).T
        weights = weights / weights.sum(axis=0)
        return np.asarray(np.sqrt(((weights * errors) ** 2).sum(axis=0)))

    def _own_errors(self, lags: list[tuple[int, int]], shift: int, over: int | None) -> FloatArray:
        """Errors as `_errors`, of this run only."""
        time = np.array([k * 2**level for level, k in lags])
        groups = np.array([self._group_variance(level, shift + k, over) for level, k in lags])
        blocks = np.array([self._block_variance(level, k, shift + k, over) for level, k in lags])
        known = np.isfinite(blocks)
        together = 1.0
        if known.any():
            both = known & (time >= time[known].max() / 2) & (groups > 0.0)
            together = max(float(np.mean(blocks[both] / groups[both])), 1.0) if both.any() else 1.0
        return np.asarray(np.sqrt(np.where(known, blocks, together * groups)))

    def _group_variance(self, level: int, place: int, over: int | None) -> float:
        """Variance of a column's mean, or of its ratio to another's, for independent groups of particles."""
        sums = self._groups_by_level[level]
        total = sums.sum(axis=1)
        if over is None:
            own, scale = sums[place], float(self._particles * self._rows_by_level[level].n_samples)
            sizes = np.bincount(np.arange(self._particles) % sums.shape[1]) / self._particles
            centred = own - sizes * total[place]
        else:
            scale = float(total[over])
            centred = sums[place] - total[place] / scale * sums[over]
        count = sums.shape[1]
        if count < 2:
            return math.nan
        return float((centred @ centred) * count / (count - 1) / scale**2)

    def _block_variance(self, level: int, k: int, place: int, over: int | None) -> float:
        """Variance from blocks of origins, each of four lags or more; NaN where there are too few blocks."""
        series = self._rows_by_level[level]
        rows, shortest = series.rows, math.ceil(4 * k / series.samples_per_row)
        if 4 * len(rows) < WINDOWS * shortest:
            return math.nan
        with warnings.catch_warnings():
            warnings.simplefilter("error", SeriesWarning)
            try:
                if over is None:
                    estimate = estimate_from_series(rows[:, place], shortest=shortest)
                else:
                    both = rows[:, [place, over]]
                    estimate = estimate_from_series(both, lambda mean: mean[..., 0] / mean[..., 1], shortest)
            except SeriesWarning:
                return math.nan
        return float(estimate.standard_error**2)

    # Diffusion ----------------------------------------------------------------------------------------------

    def diffusion(self, window: tuple[float, float]) -> Estimate:
        """Return D_L of this box from the slope of the mean square displacement over a window of lags.

        D = [MSD(t2) - MSD(t1)] / (2 d (t2 - t1)), by Einstein's relation; the mean over the window of the
        integral of the velocity autocorrelation up to t. From the two ends alone, both seen from the same
        origins, so that the error is right. Bias: at times t the slow tail t^(-d/2) of the autocorrelation is
        cut off, which makes D too small; `box_window` is late enough for a cubic box. For the infinite fluid
        see `infinite_diffusion`.

        Parameters
        ----------
        window : (float, float)
            t1 < t2 [time], t2 at most `points` times t1 and no longer than the longest of `lags`. The nearest
            lags of one level are used.

        Returns
        -------
        Estimate
            [length^2/time].

        Raises
        ------
        ValueError
            If the window does not fit the lags.
        """
        level, first, last = self._level_of(window)
        scale = 2 * self.scene.dim * ((last - first) * 2.0**level * self.spacing)
        return self._pooled(level, lambda rows: (rows[:, last - 1] - rows[:, first - 1]) / scale)

    def diffusion_from_velocities(self, until: float) -> Estimate:
        """Return D_L from the integral of the velocity autocorrelation, by Green and Kubo's relation.

        D(t) = (1/d) integral of <v(0).v(t')> from 0 to t = `until`, by Simpson's rule over the lags of one
        level. Bias: the tail beyond t is cut off, as in `diffusion`, whose value is the mean of D(t) over its
        window; and, with h the spacing of the level, some (h nu)^4/1000 of Simpson's rule, nu the collision
        rate.

        Parameters
        ----------
        until : float
            t [time], an even number of spacings of the finest level that reaches it; no longer than `lags`.

        Returns
        -------
        Estimate
            [length^2/time].

        Raises
        ------
        ValueError
            If the lags do not reach so far, or hold fewer than two spacings.
        """
        longest = float(self.lags[-1])
        level = max(math.ceil(math.log2(until / self.spacing / self.points) - 1e-9), 0) if until > 0.0 else 0
        step = self.spacing * 2.0**level
        last = 2 * round(until / step / 2.0)
        if not (0.0 < until <= longest * (1 + 1e-9) and last >= 2 and level <= self._lags()[-1][0]):
            raise ValueError(
                f"until = {until:g}; expected at least {2 * self.spacing:g}, two spacings, and at most "
                f"{longest:g}"
            )
        weights = np.ones(last + 1)
        weights[1:-1:2], weights[2:-1:2] = 4.0, 2.0
        scale, first = step / (3.0 * self.scene.dim), self.points
        return self._pooled(level, lambda rows: rows[:, first : first + last + 1] @ weights * scale)

    def _level_of(self, window: tuple[float, float]) -> tuple[int, int, int]:
        """Level of a window, and the places of its ends there."""
        longest = float(self.lags[-1])
        begin, end = window
        if 0.0 < begin < end <= longest * (1 + 1e-9):
            level = max(math.ceil(math.log2(end / self.spacing / self.points) - 1e-9), 0)
            step = self.spacing * 2.0**level
            first, last = round(begin / step), round(end / step)
            if 1 <= first < last and level <= self._lags()[-1][0]:
                return level, first, last
        raise ValueError(
            f"window = {window}; expected 0 < t1 < t2 <= {longest:g}, t2 at most {self.points} t1, in "
            "steps of "
            f"{self.spacing:g} or more"
        )

    def _cube(self) -> tuple[float, float, float, float, float]:
        """Arguments of the theory of a periodic cube."""
        scene = self.scene
        if scene.dim != 3:
            raise ValueError("in 2D diffusion has no infinite limit: D grows as the logarithm of the box")
        if not self._is_cube():
            raise ValueError("the correction is for one species in a cubic box, periodic along every axis")
        return self._sphere()

    def _sphere(self) -> tuple[float, float, float, float, float]:
        """Packing fraction, edge, diameter, mass and temperature."""
        scene = self.scene
        sphere = 2.0 * float(scene.radii[0]), float(scene.masses[0]), scene.temperature
        return scene.packing_fraction, float(scene.box[0]), *sphere

    def _is_cube(self) -> bool:
        scene = self.scene
        cubic = np.ptp(scene.box) <= 1e-9 * scene.box[0]
        return bool(scene.dim == 3 and scene.periodic.all() and cubic and scene.species.max() == 0)

    @property
    def box_window(self) -> tuple[float, float]:
        """Lags where the slope is D of this box, [time]: `theory.periodic_diffusion_window`; 3D cube only."""
        return theory.periodic_diffusion_window(*self._cube())

    @property
    def periodic_correction(self) -> theory.Prediction:
        """Reduction of D by the periodic box (`theory.periodic_diffusion_correction`); 3D cube only."""
        return theory.periodic_diffusion_correction(*self._cube())

    def infinite_diffusion(self, window: tuple[float, float] | None = None) -> Estimate:
        """Return D of the infinite fluid, `diffusion` plus `theory.periodic_diffusion_correction`.

        Parameters
        ----------
        window : (float, float), optional
            As in `diffusion`; `box_window` by default. For an earlier window the correction includes the
            missing tail.

        Returns
        -------
        Estimate
            [length^2/time]; the uncertainty of the correction is in its error.

        Warns
        -----
        ShortWindowWarning
            If the window begins before `box_window`.

        Raises
        ------
        ValueError
            If the window does not fit the lags, or the gas is not one of equal spheres in a periodic cube.
        """
        cube, needed = self._cube(), self.box_window
        begin, end = window or needed
        if window is None and end > float(self.lags[-1]):
            raise ValueError(
                f"the lags reach {self.lags[-1]:.4g}; D of this box is the slope from {begin:.4g} to "
                f"{end:.4g}: run longer, or give an earlier window"
            )
        here = self.diffusion((begin, end))
        if begin < 0.9 * needed[0]:
            message = (
                f"the slope is from {begin:.4g} to {end:.4g}, too early for D of this box, {needed[0]:.4g} "
                f"to {needed[1]:.4g}: theory supplies the rest of the tail"
            )
            warnings.warn(ShortWindowWarning(message), stacklevel=2)
        return with_correction(here, theory.periodic_diffusion_correction(*cube, window=(begin, end)))

    def _enskog(self) -> theory.Prediction:
        """Enskog's D of a gas of one species."""
        eta, _, *units = self._sphere()
        return theory.enskog_diffusion(eta, self.scene.dim, *units)

    @property
    def checks(self) -> list[TheoryCheck]:
        """D beside Enskog's: `check` with its own window, that of the box.

        Empty where there is no such window or theory: in a mixture, in 2D and where the box is no periodic
        cube. There give `check` a window.
        """
        self._lags()
        if not self._is_cube():
            return []
        end = self.box_window[1]
        self._require(end <= float(self.lags[-1]), f"lag of {end:.4g}", "add(sim) in a longer run")
        return self.check()

    def check(self, window: tuple[float, float] | None = None) -> list[TheoryCheck]:
        """Return D_L, and in a 3D cube D of the infinite fluid, beside Enskog's D_E with its uncertainty.

        Parameters
        ----------
        window : (float, float), optional
            As in `infinite_diffusion`; needed where there is no cube.
        """
        scene = self.scene
        if scene.species.max() > 0:
            raise ValueError("Enskog's D here is for one species; this gas is a mixture")
        enskog = self._enskog()
        value, uncertainty = float(enskog.value), float(enskog.uncertainty)
        infinite = []
        if self._is_cube():
            measured = self.infinite_diffusion(window)
            infinite = [TheoryCheck("D of the infinite fluid", "Enskog", measured, value, uncertainty)]
        here = self.diffusion(window or self.box_window)
        return [TheoryCheck("D in this box", "Enskog", here, value, uncertainty), *infinite]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the mean square displacement with its errors, over free flight and Enskog's diffusion."""
        lags, value, error = self.lags, self.mean_square_displacement, self.mean_square_displacement_error
        scene = self.scene
        axes = axes_or_new(ax)
        axes.errorbar(lags, value, np.nan_to_num(error), fmt="o", ms=3, color="C0", label="simulation")
        mean_square = float(self._mean(0)[self.points])
        early = lags[mean_square * lags**2 < 3 * value]
        axes.plot(early, mean_square * early**2, color="0.6", lw=1.5, label="free flight")
        if scene.species.max() == 0:
            enskog = float(self._enskog().value)
            axes.plot(lags, 2 * scene.dim * enskog * lags, color="0.25", lw=1.5, label="Enskog")
        axes.set_xscale("log")
        axes.set_yscale("log")
        return labelled(axes, "time", "mean square displacement")


def with_correction(here: Estimate, correction: theory.Prediction) -> Estimate:
    """Return a measured D plus a correction from theory; its uncertainty is part of the standard error."""
    error = math.hypot(here.standard_error, float(correction.uncertainty))
    share = here.standard_error**2 / error**2 if error > 0.0 else 1.0
    freedom = here.degrees_of_freedom / share**2 if share > 0.0 else math.inf
    return Estimate(here.value + float(correction.value), error, here.n_effective, freedom)
