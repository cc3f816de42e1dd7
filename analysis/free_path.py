"""Mean free paths and times, rates between species, the distributions of free paths and times, lambda(v)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis import theory
from analysis.estimator import PALETTE, TalliedEstimator, axes_or_new, labelled
from analysis.pressure import Pressure
from analysis.statistics import Estimate, TheoryCheck
from analysis.theory import FreeFlights, Prediction

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from hardspheres import Frame, Scene

__all__ = ["FirstFlightsWarning", "FreePath"]

FloatArray = NDArray[np.float64]
Kind = Literal["path", "time"]

ROWS = 256  # of the series of blocks: each holds whole histograms
FEW = 10  # collisions, of which blocks cannot tell the error
SURVIVAL_AT = (0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0)
SPEED_BINS = 20  # a quarter of a thermal speed each
FINE = 4  # bins of the engine in one of these


class FirstFlightsWarning(UserWarning):
    """Flights from before the simulation ended in a block: the distributions lack these, mostly long ones."""


class FreePath(TalliedEstimator):
    """Free paths and times from what the engine counts of flights between frames.

    Give it the frames of one simulation; each two in succession make a block. `analysis.pressure.Pressure`
    takes the same frames:

    >>> import hardspheres as hs
    >>> sim = hs.Simulation(hs.lattice_gas(n=108, packing_fraction=0.1, seed=1), free_paths=True)
    >>> sim.run(collisions=50 * 108)  # equilibrate, and let every particle collide
    >>> free_path = FreePath(sim.scene)
    >>> s = sim.collisions_per_particle
    >>> for frame in sim.frames(collisions_per_particle=[s + 20 * k for k in range(101)]):
    ...     free_path.add(frame)  # doctest: +SKIP
    >>> print(free_path.mean_free_path[0])  # doctest: +SKIP
    0.9093(11)

    The mean free path is all path flown over all ends of flights, unbiased in a block of any length.
    Everything about single flights is from those that ended in a block, each with its whole length: unbiased
    in a steady state (`hardspheres.free_paths.FreePaths` says why). Paths are measured in the frame of the
    box, so theory holds for gases at rest. All results are ratios of sums over blocks, with errors from
    blocks of automatic length (`series.estimate_from_series`, which also warns of too few blocks and of a
    drift): give 100 blocks or more. Memory does not grow beyond 256 rows of histograms.

    Results come for each species, in the order of `Scene.species`.

    Parameters
    ----------
    scene : Scene
        The gas: `sim.scene`.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene, ROWS, "free paths")
        gas = self._gas
        self._particles, self._diameters, self._masses = gas.sizes, gas.diameters, gas.masses
        self._edges: dict[str, FloatArray] = {}
        self._columns: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._ends, self._first = 0, 0

    # Collecting ---------------------------------------------------------------------------------------------

    def add(self, frame: Frame) -> Self:
        """Take in what was counted since the frame before; the first frame only starts.

        Parameters
        ----------
        frame : Frame
            `sim.frame()`, or one of `sim.frames(...)`, of a ``Simulation(scene, free_paths=True)``.

        Warns
        -----
        FirstFlightsWarning
            If more than one flight in a thousand began before the simulation, as far as frames have come.

        Raises
        ------
        ValueError
            If the frame is of another gas or simulation, is not later than the one before, or has no free
            paths.
        """
        self._require_next(frame)
        free_paths = frame.free_paths
        if free_paths is None:
            raise ValueError("the frame has no free paths; construct with Simulation(scene, free_paths=True)")
        self._edges = {
            "path": free_paths.path_edges,
            "time": free_paths.time_edges,
            "speed": free_paths.speed_edges,
        }
        parts = {
            "time": np.array([free_paths.time]),
            "ends": free_paths.flights + free_paths.first_flights,
            "flown": free_paths.path_flown,
            "flights": free_paths.flights,
            "path_sums": free_paths.path_sums,
            "time_sums": free_paths.time_sums,
            "path_counts": free_paths.path_counts,
            "time_counts": free_paths.time_counts,
            "speed_counts": free_paths.speed_counts,
            "speed_paths": free_paths.speed_paths,
            "speed_times": free_paths.speed_times,
            "pairs": free_paths.pair_collisions,
        }
        starts = np.cumsum([0, *(part.size for part in parts.values())])
        self._columns = {name: (int(k), parts[name].shape) for name, k in zip(parts, starts, strict=False)}
        block = self._since_last(frame, np.concatenate([np.ravel(part) for part in parts.values()]))
        if block is None:
            return self
        self._blocks.add(block)
        ends, flights = (self._column(block, name).sum() for name in ("ends", "flights"))
        self._ends += int(ends)
        self._first += int(ends - flights)
        if self._first > 1e-3 * self._ends:
            message = (
                f"{self._first} of {self._ends} flights began before the simulation and are left out, "
                "long ones most of all; let every particle collide before the first frame"
            )
            warnings.warn(FirstFlightsWarning(message), stacklevel=2)
        return self

    def _column(self, rows: FloatArray, name: str) -> FloatArray:
        """Return the columns of this name of rows (..., p)."""
        start, shape = self._columns[name]
        return rows[..., start : start + math.prod(shape)]

    def _take_in(self, other: Self) -> None:
        super()._take_in(other)
        self._edges, self._columns = self._edges or other._edges, self._columns or other._columns
        self._ends += other._ends
        self._first += other._first

    @property
    def flights(self) -> int:
        """How many flights were tallied, all species together."""
        return self._ends - self._first

    def _rows(self, *names: str) -> FloatArray:
        """Means of these columns in each row of the series of all runs, side by side: (rows, p)."""
        self._require_blocks()
        rows = np.concatenate([series.rows for series in self._series()])
        return np.concatenate([self._column(rows, name) for name in names], axis=1)

    def _of_runs(self, rows: FloatArray) -> list[FloatArray]:
        """Return the rows of each run."""
        return np.split(rows, np.cumsum([len(series) for series in self._series()])[:-1])

    def _total(self, rows: FloatArray) -> FloatArray:
        """Return the sum over all blocks of what rows are means of."""
        together = zip(self._of_runs(rows), self._series(), strict=True)
        return np.asarray(sum(part.mean(axis=0) * series.n_samples for part, series in together))

    def _estimate(self, rows: FloatArray, statistic: Callable[[FloatArray], FloatArray]) -> Estimate:
        """Return a function of the mean row."""
        ends = self._rows("ends").sum(axis=1)
        return self._from_blocks(self._of_runs(rows), statistic, self._of_runs(ends))

    def _ratio(self, above: FloatArray, below: FloatArray, factor: float = 1.0) -> Estimate:
        """Ratio of the sums of two columns."""
        return self._estimate(
            np.stack([above, below], axis=1), lambda mean: factor * mean[..., 0] / mean[..., 1]
        )

    @property
    def labels(self) -> list[str]:
        """What tells the species apart; "all" where there is one."""
        return self._gas.labels

    # Means and rates ----------------------------------------------------------------------------------------

    @property
    def mean_free_path(self) -> list[Estimate]:
        """Mean free path of each species: path flown by all its particles over its collisions, [length].

        Unbiased in a window of any length. Walls do not end a free path.
        """
        flown, ends = self._rows("flown"), self._rows("ends")
        return [self._ratio(flown[:, k], ends[:, k]) for k in range(len(self._particles))]

    @property
    def mean_free_time(self) -> list[Estimate]:
        """Mean free time of each species: particles times time over collisions, [time]."""
        time, ends = self._rows("time")[:, 0], self._rows("ends")
        return [self._ratio(time, ends[:, k], float(n)) for k, n in enumerate(self._particles)]

    @property
    def mean_speed(self) -> list[Estimate]:
        """Mean speed of each species: path flown by all its particles over particles times time, [speed]."""
        time, flown = self._rows("time")[:, 0], self._rows("flown")
        return [self._ratio(flown[:, k], time, 1.0 / float(n)) for k, n in enumerate(self._particles)]

    @property
    def collision_rates(self) -> list[list[Estimate]]:
        """nu_ij, how often a particle of species i meets one of species j, [1/time]; k lists of k.

        Collisions of unlike particles are the same in nu_ij and nu_ji: rho_i nu_ij = rho_j nu_ji. Of fewer
        than 10 collisions the error is Poisson's at least, that of one where none was seen.
        """
        time, pairs = self._rows("time")[:, 0], self._rows("pairs")
        kinds = range(len(self._particles))

        def rate(i: int, j: int) -> Estimate:
            count, factor = pairs[:, i * len(kinds) + j], (1.0 + (i == j)) / float(self._particles[i])
            estimate = self._ratio(count, time, factor)
            seen = float(self._total(count))
            floor = factor * math.sqrt(max(seen, 1.0)) / float(self._total(time))
            if seen >= FEW or estimate.standard_error >= floor:
                return estimate
            return Estimate(estimate.value, floor, max(seen, 1.0))

        return [[rate(i, j) for j in kinds] for i in kinds]

    @property
    def compressibility_factor(self) -> Estimate:
        """Z from the same collisions, exact at equilibrium: see `Pressure.rate`.

        The formula is that of `theory.compressibility_from_rate`.
        """
        rows, kinds = self._rows("time", "pairs"), len(self._particles)
        freedom, temperature = self.scene.degrees_of_freedom, self.scene.temperature

        def compressibility(means: FloatArray) -> FloatArray:
            rates = (means[..., 1:] / means[..., :1]).reshape(*means.shape[:-1], kinds, kinds)
            return theory.compressibility_from_rate(
                rates, self._diameters, self._masses, temperature, freedom
            )

        return self._estimate(rows, compressibility)

    # Distributions ------------------------------------------------------------------------------------------

    def _kind(self, species: int) -> int:
        if not 0 <= species < len(self._particles):
            raise ValueError(f"species = {species}; the gas has {len(self._particles)}, counted from 0")
        return species

    def moment(self, order: int, of: Kind = "path", species: int = 0) -> Estimate:
        """Return <l^k> / <l>^k of free paths or times, k = 2 or 3; an exponential has k!.

        Parameters
        ----------
        order : {2, 3}
            k.
        of : {"path", "time"}
            Of which.
        species : int, default 0
            Whose flights.
        """
        if order not in (2, 3):
            raise ValueError(f"order = {order}; the engine adds up squares and cubes, ask for 2 or 3")
        sums = self._rows(f"{of}_sums")[:, 3 * self._kind(species) :]
        columns = np.stack([self._rows("flights")[:, species], sums[:, 0], sums[:, order - 1]], axis=1)
        return self._estimate(columns, lambda m: (m[..., 2] / m[..., 0]) / (m[..., 1] / m[..., 0]) ** order)

    def survival(self, x: ArrayLike = SURVIVAL_AT, of: Kind = "path", species: int = 0) -> list[Estimate]:
        """Return how large a part of the flights is longer than x means of their own.

        Parameters
        ----------
        x : (p,) array_like
            In units of the measured mean free path or time; 1/256 to 100.
        of : {"path", "time"}
            Of which.
        species : int, default 0
            Whose flights.

        Returns
        -------
        list of Estimate
            One for each x. Between the edges of the engine's bins, 1/16 to 1/32 of x apart, the logarithm is
            taken as linear: a relative bias below 1e-4. The error bars know that the mean is measured too.
        """
        kind = self._kind(species)
        edges = self._edges[of][kind][:-1] if self._edges else np.zeros(1)
        bins = len(edges)
        sums, flights = self._rows(f"{of}_sums"), self._rows("flights")
        counts = self._rows(f"{of}_counts")[:, bins * kind : bins * (kind + 1)]
        columns = np.concatenate(
            [sums[:, 3 * kind : 3 * kind + 1], flights[:, kind : kind + 1], counts], axis=1
        )

        def beyond(at: float) -> Callable[[FloatArray], FloatArray]:
            def part(means: FloatArray) -> FloatArray:
                flat = means.reshape(-1, means.shape[-1])
                # Without the one block that has the longest flights their number is 0 but for rounding.
                longer = np.maximum(np.cumsum(flat[:, :1:-1], axis=1)[:, ::-1], 0.0)  # beyond each edge
                with np.errstate(divide="ignore"):
                    logs = np.log(longer / flat[:, 1:2])
                wanted = at * flat[:, 0] / flat[:, 1]
                found = [np.interp(w, edges, log) for w, log in zip(wanted, logs, strict=True)]
                return np.asarray(np.exp(np.array(found)).reshape(means.shape[:-1]))

            return part

        return [self._estimate(columns, beyond(float(at))) for at in np.atleast_1d(np.asarray(x))]

    def path_at_speed(self, species: int = 0) -> tuple[FloatArray, list[Estimate]]:
        """Return lambda(v), the mean free path of the flights at a speed.

        Returns
        -------
        edges : (b + 1,) array
            Bins of speed, a quarter of sqrt(kT/m) wide, [length/time]; from the first with 100 flights to the
            last.
        paths : list of Estimate
            One for each bin, [length]; NaN for bins between that fewer than 10 blocks have flights in.
        """
        edges, counts, sums = self._by_speed("paths", species)
        return edges, [self._ratio_at_speed(a, b, b) for a, b in zip(sums.T, counts.T, strict=True)]

    def rate_at_speed(self, species: int = 0) -> tuple[FloatArray, list[Estimate]]:
        """Return nu(v), the collision rate of the particles at a speed, [1/time]; as `path_at_speed`."""
        edges, counts, sums = self._by_speed("times", species)
        return edges, [self._ratio_at_speed(a, b, a) for a, b in zip(counts.T, sums.T, strict=True)]

    def _ratio_at_speed(self, above: FloatArray, below: FloatArray, counts: FloatArray) -> Estimate:
        """Return the ratio of two columns of a bin of speeds.

        NaN where too few blocks have flights in it, as of a frozen species.
        """
        if np.count_nonzero(counts) < FEW:
            return Estimate(math.nan, math.nan, 0.0, 0.0)
        return self._ratio(above, below)

    def _by_speed(self, what: str, species: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Edges of wide bins, and the counts and sums in them, (rows, bins)."""
        kind, wide = self._kind(species), SPEED_BINS * FINE

        def joined(name: str) -> FloatArray:
            columns = self._rows(name)
            per_species = columns.reshape(len(columns), len(self._particles), -1)[:, kind, :wide]
            return np.asarray(per_species.reshape(len(columns), SPEED_BINS, FINE).sum(axis=2))

        counts, sums = joined("speed_counts"), joined(f"speed_{what}")
        filled = np.flatnonzero(self._total(counts) >= 100.0)
        self._require(len(filled) > 0, "speed with 100 flights", "add(frame) with more frames")
        first, last = int(filled[0]), int(filled[-1]) + 1
        edges = self._edges["speed"][kind][: wide + 1 : FINE]
        return edges[first : last + 1], counts[:, first:last], sums[:, first:last]

    # Theory -------------------------------------------------------------------------------------------------

    def flights_in_theory(self, species: int = 0) -> FreeFlights:
        """Return the theory of this species' flights, at the scene's temperature."""
        return FreeFlights(
            self._particles / self.scene.volume,
            self._diameters,
            self._masses,
            self.scene.dim,
            self._kind(species),
            self.scene.temperature,
            self._particles if self.scene.periodic.all() else None,
        )

    def _wall_uncertainty(self) -> float:
        """Relative uncertainty of rates for the volume that walls exclude, and their layer."""
        scene = self.scene
        if scene.periodic.all():
            return 0.0
        denser, eta, dim = self._density_between_walls(), scene.packing_fraction, scene.dim
        doubt = float(theory.collision_rate(denser, dim) / theory.collision_rate(eta, dim)) - 1.0
        return math.hypot(doubt, 1.0 / scene.n)

    def _momentum_share(self, species: int) -> float:
        """Part of a particle's motion that the conserved total momentum takes, m/M in a periodic box."""
        return float(self.scene.periodic.mean() * self._masses[species] / (self._masses @ self._particles))

    @property
    def predictions(self) -> dict[str, list[Prediction]]:
        """Theory of "mean free path" and "mean free time" of each species, and of "nu i-j" as a list of one.

        `theory.finite_size_mixture_rates`, exact in the velocities of N particles at fixed energy and
        momentum; the path is `theory.finite_mean_speed` over the rate. Between walls the change that the
        volume excluded by walls would make, and 1/N, are uncertain.
        """
        scene, kinds = self.scene, range(len(self._particles))
        dim, freedom = scene.dim, scene.degrees_of_freedom
        law = theory.finite_size_mixture_rates(
            self._particles,
            scene.volume,
            self._diameters,
            self._masses,
            dim,
            scene.temperature,
            None if scene.periodic.all() else freedom,
            float(scene.box.min() / (self._diameters @ self._particles) * scene.n),
        )
        rates = law.value
        doubts = np.hypot(law.uncertainty, self._wall_uncertainty() * rates)
        totals = rates.sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):  # one particle alone
            times, relatives = 1.0 / totals, doubts.sum(axis=1) / totals
        speeds = [
            theory.finite_mean_speed(
                freedom, dim, self._momentum_share(k), float(self._masses[k]), scene.temperature
            )
            for k in kinds
        ]
        paths = speeds * times
        named = {
            "mean free path": [Prediction(float(paths[k]), float(relatives[k] * paths[k])) for k in kinds],
            "mean free time": [Prediction(float(times[k]), float(relatives[k] * times[k])) for k in kinds],
        }
        for i in kinds:
            for j in kinds:
                named[f"nu {i + 1}-{j + 1}"] = [Prediction(float(rates[i, j]), float(doubts[i, j]))]
        return named

    @property
    def checks(self) -> list[TheoryCheck]:
        """Means, rates between species and moments of each species beside theory, then Z from the rate.

        The moments are those of the dilute gas, whose uncertainty eta (and 1/N) is what a denser one may
        differ by. Between two walls and periodic along another axis momentum is conserved in part: m/M of the
        particle is uncertain.
        """
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", theory.TheoryRangeWarning)  # a check without theory says so
            return self._checks()

    def _checks(self) -> list[TheoryCheck]:
        partly = bool(self.scene.periodic.any()) and not self.scene.periodic.all()
        expected, name = self.predictions, "Enskog"
        kinds = range(len(self._particles))
        species = [""] if len(kinds) == 1 else [f" of species {k + 1}" for k in kinds]
        checks = []
        means = {"mean free path": self.mean_free_path, "mean free time": self.mean_free_time}
        for quantity, measured in means.items():
            for label, value, p in zip(species, measured, expected[quantity], strict=True):
                checks.append(TheoryCheck(quantity + label, name, value, p.value, p.uncertainty))
        for i, row in enumerate(self.collision_rates):
            for j, rate in enumerate(row):
                if len(row) > 1 and (i != j or self._particles[i] > 1):
                    quantity = f"nu {i + 1}-{j + 1}"
                    p = expected[quantity][0]
                    checks.append(TheoryCheck(quantity, name, rate, p.value, p.uncertainty))
        for k, label in enumerate(species if self.scene.n > 2 else []):  # two may fly on for ever: no <l^3>
            flights = self.flights_in_theory(k)
            for of, symbol in (("path", "l"), ("time", "t")):
                for order in (2, 3):
                    p = flights.path_moment(order) if of == "path" else flights.time_moment(order)
                    expected_moment = float(p.value)
                    few = max(1.0 / self.scene.n, self._momentum_share(k) if partly else 0.0)
                    doubt = math.hypot(float(p.uncertainty), expected_moment * few)
                    measured_moment = self.moment(order, of, k)  # type: ignore[arg-type]
                    quantity = f"<{symbol}^{order}>/<{symbol}>^{order}{label}"
                    checks.append(TheoryCheck(quantity, "Boltzmann", measured_moment, expected_moment, doubt))
        best, z = next(iter(Pressure(self.scene).predictions.items()))
        measured_z = self.compressibility_factor
        return [*checks, TheoryCheck("Z from the collision rate", best, measured_z, z.value, z.uncertainty)]

    def plot(self, ax: Axes | None = None, x: Sequence[float] = SURVIVAL_AT) -> Axes:
        """Draw the survival function of free paths of each species, in units of its own mean, over theory.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; a new figure when absent.
        x : sequence of float
            Where to measure.
        """
        measured = [self.survival(x, species=k) for k in range(len(self._particles))]
        axes = axes_or_new(ax)
        fine = np.linspace(0.0, 1.1 * max(x), 200)
        axes.plot(fine, np.exp(-fine), color="0.6", lw=1.0, ls="--", label="exponential")
        alone = len(measured) == 1
        for k, (label, points) in enumerate(zip(self.labels, measured, strict=True)):
            law, colour = self.flights_in_theory(k).path_survival(fine).value, PALETTE[k % len(PALETTE)]
            axes.plot(fine, law, color=colour, label="Boltzmann" if alone else None)
            values, errors = [p.value for p in points], [p.standard_error for p in points]
            name = "simulation" if alone else label
            axes.errorbar(x, values, errors, fmt="o", color=colour, label=name)
        axes.set_yscale("log")
        return labelled(axes, "free path / mean free path", "part of the flights that are longer")
