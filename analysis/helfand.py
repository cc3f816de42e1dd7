"""Transport coefficients by the formulas of Einstein and Helfand and of Green and Kubo, from tallies."""

from __future__ import annotations

import math
import warnings
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis import theory
from analysis.estimator import (
    Estimator,
    axes_or_new,
    counted,
    labelled,
    over_runs,
    require_same_simulation,
    tallies_of,
)
from analysis.reduced import Gas
from analysis.series import BlockSeries, SeriesWarning, estimate_from_runs
from analysis.statistics import Estimate, TheoryCheck

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["HeatConductivity", "HelfandEstimator", "MutualDiffusion", "Viscosity", "mean_free_time"]

FloatArray = NDArray[np.float64]

FEWEST_WINDOWS = 8  # origins of the longest lag, in lags: for an error from blocks that are as long


@dataclass
class _Levels:
    """Mean squares of the increments of a moment G(t) over lags spaced by powers of two.

    Level l keeps the last `points` of every 2^l-th sample; a row has, of each lag and group of components of
    G, the mean square of the increment and its mean, (points, 2, groups).
    """

    points: int
    count: int = 0
    past: list[FloatArray] = field(default_factory=list)  # samples twice, `points` apart: the last in a row
    kept: list[int] = field(default_factory=list)  # how many samples each level has seen
    rows: list[BlockSeries] = field(default_factory=list)
    first: FloatArray = field(default_factory=lambda: np.zeros(0))

    def add(self, moment: FloatArray, groups: FloatArray) -> None:
        """Compare a sample with the last ones of each level that it belongs to.

        Parameters
        ----------
        moment : (c,) array
            G now.
        groups : (c, g) array
            Weights of the components in each mean.
        """
        if self.count == 0:
            self.first = moment
        level, every = 0, 1
        while self.count % every == 0 and (self.count or level == 0):
            if level == len(self.past):
                self.past.append(np.zeros((2 * self.points, len(moment))))
                self.kept.append(0)
                self.rows.append(BlockSeries(256))
                if self.count:
                    self._keep(level, self.first)
            if self.kept[level] >= self.points:
                begin = self.kept[level] % self.points
                change = moment - self.past[level][begin : begin + self.points]
                self.rows[level].add(np.array([change * change, change])[:, ::-1] @ groups)
            self._keep(level, moment)
            level, every = level + 1, 2 * every
        self.count += 1

    def _keep(self, level: int, moment: FloatArray) -> None:
        self.past[level][self.kept[level] % self.points :: self.points] = moment
        self.kept[level] += 1

    def reaches(self, level: int) -> bool:
        """Whether the level has two origins or more."""
        return level < len(self.rows) and len(self.rows[level]) >= 2


class HelfandEstimator(Estimator):
    """Base of transport coefficients that are slopes of the mean square of a tallied moment G(t).

    Einstein and Helfand (Helfand, Phys. Rev. 119, 1 (1960), doi 10.1103/PhysRev.119.1): a coefficient is the
    slope of <(G(t) - G(0))^2>/2 after the relaxation of the gas, over volume and temperature; G is the time
    integral of a flux, collisional transfers included. Green and Kubo's integral of the autocorrelation of
    the flux, up to a time, is the slope there: both come from the same increments. The flux has no
    discretisation error, since each sample is an exact integral of it.

    Add frames of one simulation that are equally spaced in time, a fraction of the mean free time apart. Lags
    are 1 to `points` spacings, then points/2 + 1 to `points` double spacings, and so on (`_Levels`).

    Parameters
    ----------
    points : int, default 16
        Snapshots per level; even, at least 4.
    """

    def __init__(self, points: int = 16) -> None:
        if points < 4 or points % 2:
            raise ValueError(f"points = {points}; expected an even number of at least 4")
        self.points = points
        self._levels = _Levels(points)
        self._times: list[float] = []  # the first two, and the last
        self._scene: Scene | None = None
        self._motion = np.zeros(0)  # of the centre of mass
        self._merged: list[Self] = []  # other runs

    # What a coefficient is ----------------------------------------------------------------------------------

    @abstractmethod
    def _moment(self, frame: Frame) -> FloatArray:
        """Return G(t), all components."""

    def _groups(self, components: int) -> FloatArray:
        """Return the weight of each component of G in each coefficient, (c, groups)."""
        return np.full((components, 1), 1.0 / components)

    @abstractmethod
    def _unit(self, group: int) -> float:
        """Return <(G(t) - G(0))^2>/2 over the coefficient and t: volume and temperature."""

    # Collecting ---------------------------------------------------------------------------------------------

    def add(self, frame: Frame) -> Self:
        """Add one frame.

        Parameters
        ----------
        frame : Frame
            Of one simulation in a periodic box, `sim.frame()` or one of `sim.frames(...)`; equally spaced in
            time.

        Raises
        ------
        ValueError
            If the simulation tallied nothing, the gas has walls or gravity, or the frame is of another
            simulation or comes at another spacing than the others.
        """
        tallies_of(frame)  # or refuses it
        scene = frame.scene
        if self._scene is None:
            self._require_gas(scene)
            self._motion = scene.momentum / float(scene.masses.sum())
        else:
            require_same_simulation(self._scene, frame)
        moment = self._moment(frame)
        self._check_time(float(frame.time))
        if self._scene is None:
            self._scene, self._gas = scene, self._gas or Gas.of(scene)
        self._levels.add(moment, self._groups(len(moment)))
        return self

    def _require_gas(self, scene: Scene) -> None:
        name = type(self).__name__
        if not scene.periodic.all() or scene.falls:
            what = "gravity" if scene.falls else "walls"
            raise ValueError(f"a gas with {what} has no {name}: fluxes are those of a periodic box")
        if not scene.thermal_energy > 0.0:
            raise ValueError(f"nothing moves in this scene; a gas without thermal motion has no {name}")

    def _check_time(self, time: float) -> None:
        known = len(self._times)
        if known:
            if not time > self._times[-1]:
                raise ValueError(
                    f"time = {time:g} is not after {self._times[-1]:g}; add each frame once, in the order of "
                    "time"
                )
            if known > 1:
                spacing = self._times[1] - self._times[0]
                expected = self._times[0] + self._levels.count * spacing
                if abs(time - expected) > 1e-3 * spacing:
                    raise ValueError(
                        f"time = {time:g}; expected {expected:g}: frames must be equally spaced, here by "
                        f"{spacing:g}"
                    )
        self._times = [*self._times[:2], time]

    @property
    def _added(self) -> str:
        return counted(sum(run._levels.count for run in self._every()), "frame")

    def _take_in(self, other: Self) -> None:
        spacings = [run.spacing for run in (self, other) if run._knows_spacing]
        if np.ptp(spacings or [0.0]) > 1e-6 * max(spacings, default=1.0):
            raise ValueError(
                f"frames {spacings[0]:g} and {spacings[1]:g} apart in time cannot be merged: the lags differ"
            )
        self._merged += [other, *other._merged]
        other._merged, other._scene = [], None
        other._levels.past = []  # of samples, which only an own run needs

    # Lags ---------------------------------------------------------------------------------------------------

    @property
    def _knows_spacing(self) -> bool:
        return any(len(run._times) > 1 for run in self._every())

    @property
    def spacing(self) -> float:
        """Time between two frames, [time]."""
        self._require(self._knows_spacing, "spacing", "add(frame) at least twice")
        times = next(run._times for run in self._every() if len(run._times) > 1)
        return times[1] - times[0]

    def _every(self) -> list[Self]:
        return [self, *self._merged]

    def _runs(self) -> list[Self]:
        """Return all runs that have lags."""
        return [run for run in self._every() if run._levels.reaches(0)]

    def _lags(self) -> list[tuple[int, int]]:
        """Level and place within it of every lag that has at least two origins in each run."""
        runs, lags, level = self._runs(), [], 0
        while runs and all(run._levels.reaches(level) for run in runs):
            first = 1 if level == 0 else self.points // 2 + 1
            lags += [(level, k) for k in range(first, self.points + 1)]
            level += 1
        self._require(bool(lags), "lags", f"add(frame) at least {self.points + 2} times")
        return lags

    @property
    def lags(self) -> FloatArray:
        """Times between two frames that are compared, ascending, (lags,), [time]."""
        return np.array([k * 2.0**level for level, k in self._lags()]) * self.spacing

    def _origins(self, level: int) -> list[int]:
        return [run._levels.rows[level].n_samples for run in self._runs()]

    def _mean(self, level: int) -> FloatArray:
        """Mean over all origins of all runs, (2, points, groups)."""
        return over_runs([run._levels.rows[level].mean for run in self._runs()], self._origins(level))

    def _drift(self, group: int) -> float:
        """Return the mean flux that is taken off; 0 by symmetry but for the bulk viscosity."""
        return 0.0

    @property
    def _length(self) -> float:
        """Length of all runs together, [time]."""
        return sum(run._levels.count - 1 for run in self._runs()) * self.spacing

    def _squares(self, rows: FloatArray, level: int, group: int) -> FloatArray:
        """Return squares of increments less those of the mean flux, (rows, points), from rows of a level."""
        lags = np.arange(1, self.points + 1) * self.spacing * 2.0**level
        drift = self._drift(group)
        if drift == 0.0:
            return rows[:, 0, :, group]
        means = 2.0 * drift * lags * rows[:, 1, :, group]
        return np.asarray(rows[:, 0, :, group] - means + (drift * lags) ** 2)

    def _holds(self, level: int, place: int) -> bool:
        """Whether there are enough origins of a lag for an error."""
        return sum(self._origins(level)) >= FEWEST_WINDOWS * place

    def _slope(self, group: int, level: int, first: int, last: int) -> Estimate:
        """Return the coefficient from the slope between two lags of a level."""
        step = self.spacing * 2.0**level
        enough = self._holds(level, last)
        self._require(enough, f"error for a lag of {last * step:.4g}", "add(frame) in a longer run")
        unit = 2.0 * self._unit(group) * (last - first) * step
        if self._drift(group) != 0.0:  # the mean flux was fitted to the same data
            unit *= 1.0 - (first + last) * step / self._length
        runs, shortest = [], []
        for run in self._runs():  # rows are means over the same number of origins
            squares = self._squares(run._levels.rows[level].rows, level, group)
            before = squares[:, first - 1] if first else 0.0
            runs.append((squares[:, last - 1] - before) / unit)
            shortest.append(math.ceil(last / run._levels.rows[level].samples_per_row))
        return estimate_from_runs(runs, shortest=shortest, weights=self._origins(level))

    # Results ------------------------------------------------------------------------------------------------

    names: ClassVar[tuple[str, ...]]
    """The coefficients, one per group of components."""

    @abstractmethod
    def expected(self) -> list[theory.Prediction]:
        """Return Enskog's value of each coefficient; none where there is no theory of this gas."""

    @property
    def checks(self) -> list[TheoryCheck]:
        """Each coefficient beside Enskog's; an empty list in a mixture, but for mutual diffusion."""
        self._lags()
        return [
            TheoryCheck(name, "Enskog", self.slope(name), float(one.value), float(one.uncertainty))
            for group, (name, one) in enumerate(zip(self.names, self.expected(), strict=False))
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw Green and Kubo's integrals up to four windows, with their errors, beside Enskog's values."""
        curves = [self.running(name) for name in self.names]
        axes = axes_or_new(ax)
        for group, (times, values, errors) in enumerate(curves):
            shown = times <= 4.0 * self.window[1]
            axes.errorbar(
                times[shown],
                values[shown],
                np.nan_to_num(errors[shown]),
                fmt="os"[group],
                ms=3,
                color=f"C{group}",
                label=self.names[group],
            )
        for group, one in enumerate(self.expected()):
            axes.axhline(float(one.value), color=f"C{group}", lw=1.5, label=f"{self.names[group]}, Enskog")
        axes.set_xscale("log")
        return labelled(axes, "time", "integral up to this time")

    @property
    def mean_free_time(self) -> float:
        """Time between two collisions of a particle by theory, the mean over all of them, [time]."""
        gas = self.gas
        return mean_free_time(gas.sizes / gas.volume, gas.diameters, gas.masses, gas.dim, gas.temperature)

    _BEGIN = 8.0  # of the slope, in mean free times

    @property
    def window(self) -> tuple[float, float]:
        """Lags of the slope by default, [time]."""
        begin = self._BEGIN * self.mean_free_time
        return begin, 2.0 * begin

    def _group(self, name: str | None) -> int:
        if name is not None and name not in self.names:
            raise ValueError(f"no coefficient is named {name!r:.60}; there is {' and '.join(self.names)}")
        return self.names.index(name) if name else 0

    def slope(self, name: str | None = None, window: tuple[float, float] | None = None) -> Estimate:
        """Return a coefficient as the slope of the mean square between two lags.

        Parameters
        ----------
        name : str, optional
            One of `names`, by default the first.
        window : (float, float), optional
            The lags; `window` by default.
        """
        group = self._group(name)
        begin, end = window or self.window
        if not 0.0 <= begin < end:
            raise ValueError(f"window = ({begin:g}, {end:g}); expected 0 <= begin < end")
        longest = float(self.lags[-1])
        self._require(end <= longest * (1.0 + 1e-9), f"lag of {end:.4g}", "add(frame) in a longer run")
        level = max(math.ceil(math.log2(end / (self.points * self.spacing)) - 1e-9), 0)
        step = self.spacing * 2.0**level
        last = max(math.floor(end / step + 0.5), 1)
        first = min(math.floor(begin / step + 0.5), last - 1)
        return self._slope(group, level, first, last)

    def integral(self, name: str | None = None, time: float | None = None) -> Estimate:
        """Return a coefficient as Green and Kubo's integral up to a time.

        Parameters
        ----------
        name : str, optional
            One of `names`, by default the first.
        time : float, optional
            By default the middle of `window`.
        """
        group = self._group(name)
        begin, end = self.window
        at = 0.5 * (begin + end) if time is None else time
        if not at >= 0.0:
            raise ValueError(f"time = {at:g}; expected at least 0")
        level = max(math.ceil(math.log2((at / self.spacing + 1.0) / (self.points - 1)) - 1e-9), 0)
        step = self.spacing * 2.0**level
        place = max(math.floor(at / step + 0.5), 1)
        self._require(
            (place + 1) * step <= self.lags[-1] * (1.0 + 1e-9),
            f"lag of {at:.4g}",
            "add(frame) in a longer run",
        )
        return self._slope(group, level, place - 1, place + 1)

    def running(self, name: str | None = None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return times, Green and Kubo's integrals up to them, and standard errors; `name` as in `integral`.

        Late in a run, where it holds few times of that length, the errors are lower bounds.
        """
        group = self._group(name)
        times, found = [], []
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SeriesWarning)
            for level in range(self._lags()[-1][0] + 1):
                for k in range(1 if level == 0 else self.points // 2, self.points):
                    if not self._holds(level, k + 1):
                        break
                    found.append(self._slope(group, level, k - 1, k + 1))
                    times.append(k * 2.0**level * self.spacing)
        values, errors = [one.value for one in found], [one.standard_error for one in found]
        return np.array(times), np.array(values), np.array(errors)


def mean_free_time(
    number_densities: FloatArray, diameters: FloatArray, masses: FloatArray, dim: int, temperature: float
) -> float:
    """Return the time between two collisions of a particle by theory, the mean over all species, [time]."""
    rates = theory.mixture_collision_rates(number_densities, diameters, masses, dim, temperature)
    return float(number_densities.sum() / (number_densities @ rates.sum(axis=1)))


def _enskog(gas: Gas, *laws: Callable[..., theory.Prediction]) -> list[theory.Prediction]:
    """Return what theories of one species say of this gas; nothing of a mixture."""
    if len(gas.sizes) > 1:
        return []
    units = float(gas.diameters[0]), float(gas.masses[0]), gas.temperature
    return [law(gas.packing_fraction, gas.dim, *units) for law in laws]


class Viscosity(HelfandEstimator):
    """Shear and bulk viscosity from the tallied pressure tensor.

    >>> viscosity = Viscosity()
    >>> for frame in sim.frames(every=0.25 * free_time, count=10000):  # doctest: +SKIP
    ...     viscosity.add(frame)
    >>> print(viscosity.shear(), viscosity.bulk())  # doctest: +SKIP

    G_ab(t) is the integral of sum m v_a v_b over time plus sum r_a dp_b over collisions: `Tallies.kinetic`
    and `Tallies.virial`, less what the common motion adds. Shear: <(G_ab(t) - G_ab(0))^2> = 2 eta V kT t, the
    mean over all (d - 1)(d + 2)/2 independent components of the traceless tensor. Bulk: the same of the trace
    over d, less its mean. At fixed energy and momentum its fluctuations are those of the virial alone, and
    nothing else has to be subtracted (Zwanzig, Annu. Rev. Phys. Chem. 16, 67 (1965)); the mean is that of the
    same data, whose effect on the slope, (begin + end) / (length of all runs), is put back.

    Relative standard error: about 2.3 sqrt(begin / T c), T the length of the run and c the number of
    components (5 in 3D and 2 in 2D for shear, 1 for bulk), at any number of particles. Bias: what the
    window leaves out, 0.1 % of relaxation after 8 mean free times and the tail t^(-d/2) of the stress
    autocorrelation, and an effect of the periodic box of order 1/N.
    """

    names = ("shear viscosity", "bulk viscosity")

    def _moment(self, frame: Frame) -> FloatArray:
        tallies = tallies_of(frame)
        dim, u, mass = frame.scene.dim, self._motion, float(frame.scene.masses.sum())
        g = tallies.virial + tallies.kinetic - mass * np.outer(u, u) * tallies.time
        g = 0.5 * (g + g.T)
        traceless = [g[a, b] for a in range(dim) for b in range(a + 1, dim)] + [0.5 * (g[0, 0] - g[1, 1])]
        if dim == 3:
            traceless.append((g[0, 0] + g[1, 1] - 2.0 * g[2, 2]) / math.sqrt(12.0))
        return np.array([*traceless, np.trace(g) / dim])

    def _groups(self, components: int) -> FloatArray:
        shear = components - 1
        return np.array([[1.0 / shear, 0.0]] * shear + [[0.0, 1.0]])

    def _unit(self, group: int) -> float:
        return self.gas.volume * self.gas.temperature

    def _drift(self, group: int) -> float:
        if group == 0:
            return 0.0
        means = self._mean(0)[1, -1, 1]
        return float(means) / (self.points * self.spacing)

    def shear(self, window: tuple[float, float] | None = None) -> Estimate:
        """Shear viscosity, [mass length^(2-d)/time].

        Parameters
        ----------
        window : (float, float), optional
            Lags between which the slope is taken; `window` by default.
        """
        return self.slope(window=window)

    def bulk(self, window: tuple[float, float] | None = None) -> Estimate:
        """Bulk viscosity, [mass length^(2-d)/time]; as `shear`."""
        return self.slope("bulk viscosity", window)

    def expected(self) -> list[theory.Prediction]:
        """Return Enskog's shear and bulk viscosity; none in a mixture."""
        return _enskog(self.gas, theory.shear_viscosity, theory.bulk_viscosity)


class HeatConductivity(HelfandEstimator):
    """Heat conductivity of one species from the tallied heat flux; k_B = 1.

    >>> sim = hs.Simulation(scene, heat=True)  # doctest: +SKIP
    >>> conductivity = HeatConductivity()
    >>> for frame in sim.frames(every=0.25 * free_time, count=10000):  # doctest: +SKIP
    ...     conductivity.add(frame)
    >>> print(conductivity.conductivity())  # doctest: +SKIP

    G(t) is the integral of sum v m v^2/2 over time plus sum r dE over collisions (`Tallies.heat_flux`,
    `Tallies.heat_transfer`), as seen from the centre of mass: <|G(t) - G(0)|^2> = 2 d lambda V (kT)^2 t. The
    enthalpy that the particles carry does not enter, as their total momentum is 0. Standard error and bias as
    of `Viscosity`; relaxation takes half as long again, so the slope begins at 12 mean free times.
    """

    names = ("heat conductivity",)
    _BEGIN = 12.0

    def _require_gas(self, scene: Scene) -> None:
        super()._require_gas(scene)
        kinds = int(scene.species.max()) + 1
        if kinds > 1:
            raise ValueError(
                f"the gas has {kinds} species; the heat flux here is that of one (in a mixture diffusion "
                "carries heat too)"
            )

    def _moment(self, frame: Frame) -> FloatArray:
        tallies = tallies_of(frame)
        if tallies.heat_flux is None or tallies.heat_transfer is None:
            raise ValueError("the frame has no heat flux; construct with Simulation(scene, heat=True)")
        u, mass = self._motion, float(frame.scene.masses.sum())
        g = tallies.virial + tallies.kinetic
        energy = float(np.trace(tallies.kinetic)) - 2.0 * mass * tallies.time * float(u @ u)
        return np.asarray(tallies.heat_flux + tallies.heat_transfer - g @ u - 0.5 * energy * u)

    def _unit(self, group: int) -> float:
        return self.gas.volume * self.gas.temperature**2

    def expected(self) -> list[theory.Prediction]:
        """Return Enskog's heat conductivity."""
        return _enskog(self.gas, theory.heat_conductivity)

    def conductivity(self, window: tuple[float, float] | None = None) -> Estimate:
        """Heat conductivity, [length^(2-d)/time].

        Parameters
        ----------
        window : (float, float), optional
            Lags between which the slope is taken; `window` by default.
        """
        return self.slope(window=window)


class MutualDiffusion(HelfandEstimator):
    """Mutual diffusion of two species: Maxwell and Stefan's coefficient.

    G(t) = x_2 R_1 - x_1 R_2, R_s the sum of all positions of species s and x_s its share of the particles;
    <|G(t) - G(0)|^2> = 2 d N x_1 x_2 D_12 t, whatever the common motion. Fick's coefficient is D_12 times the
    thermodynamic factor, 1 in a dilute gas. The tail of the current's autocorrelation beyond the window, and
    the effect of the periodic box, of order 1/L, are those of self-diffusion (`theory`'s
    `periodic_diffusion_correction`), and not put right: the result is that of this box.

    Parameters
    ----------
    points : int, default 16
        As of `HelfandEstimator`.
    labels : bool, default False
        Tell the two apart by `Scene.labels` in place of `Scene.species`: equal spheres diffuse among each
        other as one of them does, D_12 = D N/(N - 1).
    """

    names = ("mutual diffusion",)

    def __init__(self, points: int = 16, labels: bool = False) -> None:
        super().__init__(points)
        self.labels = labels
        self._shares: tuple[float, float] | None = None

    def _sorts(self, scene: Scene) -> NDArray[np.bool_]:
        """Return which particles are of the second sort."""
        words, sorts = ("labels", scene.labels) if self.labels else ("species", scene.species)
        kinds = np.unique(sorts) if sorts is not None else np.zeros(0)
        if len(kinds) != 2:
            raise ValueError(f"mutual diffusion is of two {words}; this gas has {len(kinds) or 'none'}")
        return np.asarray(sorts == kinds[1])

    def _require_gas(self, scene: Scene) -> None:
        super()._require_gas(scene)
        second = self._sorts(scene)
        self._shares = (float(np.mean(~second)), float(np.mean(second)))

    def _take_in(self, other: Self) -> None:
        if self._shares and other._shares and self._shares != other._shares:
            raise ValueError("the two gases have other shares of the two labels; they cannot be merged")
        self._shares = self._shares or other._shares
        super()._take_in(other)

    def _moment(self, frame: Frame) -> FloatArray:
        second, x = self._sorts(frame.scene), frame.unwrapped_positions
        assert self._shares is not None
        return np.asarray(self._shares[1] * x[~second].sum(axis=0) - self._shares[0] * x[second].sum(axis=0))

    def _unit(self, group: int) -> float:
        assert self._shares is not None
        return self.gas.n * self._shares[0] * self._shares[1]

    def expected(self) -> list[theory.Prediction]:
        """Return Enskog's D_12; of equal spheres that labels tell apart, his D."""
        gas = self.gas
        if len(gas.sizes) != 2:  # told apart by labels
            return _enskog(gas, theory.enskog_diffusion)
        rho = gas.sizes / gas.volume
        return [theory.mutual_diffusion(rho, gas.diameters, gas.masses, gas.dim, gas.temperature)]

    @property
    def window(self) -> tuple[float, float]:
        """Lags of the slope by default, [time]: 8 relaxation times of the current, or 8 mean free times."""
        begin, _ = super().window
        if self.expected() and len(self.gas.sizes) == 2:
            share, mass = self.gas.sizes / self.gas.n, self.gas.masses
            speed = self.gas.temperature * float(share[0] / mass[1] + share[1] / mass[0])
            begin = max(begin, self._BEGIN * float(self.expected()[0].value) / speed)
        return begin, 2.0 * begin

    def diffusion(self, window: tuple[float, float] | None = None) -> Estimate:
        """D_12, [length^2/time].

        Parameters
        ----------
        window : (float, float), optional
            Lags between which the slope is taken; `window` by default.
        """
        return self.slope(window=window)
