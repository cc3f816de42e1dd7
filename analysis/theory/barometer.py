r"""Fluids under gravity: the barometric law, hydrostatics of the dense fluid, and what few particles change.

Heights z are those of centres above where they touch the floor, up to h, where they touch the lid. In
equilibrium the chemical potential of each species changes by its weight,

.. math:: kT [\ln \eta_i + F(\eta)] + m_i g z = \mu_i, \qquad
          F(\eta) = Z - 1 + \int_0^\eta \frac{Z - 1}{\eta'} d\eta',

which is dP/dz = -g sum m_i rho_i with P = rho kT Z. Near walls particles lie in layers; the number by which
these differ from the fluid beside them is the adsorption, -d(tension)/d(mu), after scaled particle theory.

A gas of fixed energy E is not one of fixed temperature. To first order in 1/N the mean of f at E = U(T) is

.. math:: \langle f\rangle_E = \langle f\rangle_T - \frac{kT^2 C}{2} \frac{d^2 f}{dU^2}, \qquad C = dU/dT,

and the temperature of the particles at height z is T [1 - (d ln rho / d ln T) k / C]: those that have risen
have paid for it. For points without a lid both are known exactly (`barometric_density`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.theory.prediction import Prediction, check_dim, packing_fraction
from analysis.theory.state import compressibility_factor, compressibility_slope

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

__all__ = ["Barometer", "adsorption", "barometric_density", "barometric_temperature"]

FloatArray = NDArray[np.float64]

FLUID_UP_TO = {2: 0.66, 3: 0.494}
WRONG = {2: 0.25, 3: 0.1}  # relative uncertainty of the adsorption: in 2D its lowest order is 18 % too high
POINTS = 32  # at which the profile is known in each slice
STEP = 0.02  # relative change of temperature and number for derivatives


def barometric_density(z: ArrayLike, n: int, freedom: float, weight: float, temperature: float) -> FloatArray:
    """Return the probability density of the height of one of N points without a lid, at fixed energy; exact.

    m g z / E has the distribution Beta(1, N - 1 + f/2): the density falls as (1 - m g z/E)^(N - 2 + f/2), and
    for N to infinity as exp(-m g z/kT).

    Parameters
    ----------
    z : array_like
        Height.
    n : int
        Number of particles N.
    freedom : float
        Degrees of freedom f of their velocities.
    weight : float
        m g, [energy/length].
    temperature : float
        Mean of 2 K/f, [energy]: kT = E/(N + f/2).
    """
    energy = temperature * (n + freedom / 2)
    power = n - 2 + freedom / 2
    share = np.minimum(weight * np.asarray(z, dtype=np.float64) / energy, 1.0)
    with np.errstate(divide="ignore"):
        log = power * np.log1p(-share)
    return np.asarray((power + 1) * weight / energy * np.exp(log))


def barometric_temperature(
    z: ArrayLike, n: int, freedom: float, weight: float, temperature: float
) -> FloatArray:
    """Return the temperature of those of N points at a height, without a lid, at fixed energy; exact.

    (E - m g z)/(N - 1 + f/2). Parameters as in `barometric_density`.
    """
    energy = temperature * (n + freedom / 2)
    return np.asarray((energy - weight * np.asarray(z, dtype=np.float64)) / (n - 1 + freedom / 2))


def adsorption(eta: ArrayLike, dim: int) -> Prediction:
    """Return how many more centres lie at a hard wall than in the fluid beside it, per area.

    Counted from the plane that centres can reach, in units of diameters: Gamma = -d(gamma)/d(mu), gamma =
    3 eta (2 + eta)/(2 pi (1 - eta)^2) - 3 eta Z/pi in 3D, 2 eta/(pi (1 - eta)) - 2 eta Z/pi in 2D, times kT,
    from scaled particle theory (Reiss, Frisch, Helfand and Lebowitz, J. Chem. Phys. 32, 119 (1960), doi
    10.1063/1.1700883). Its lowest order is exact in 3D, 9 eta^2/pi.

    Parameters
    ----------
    eta : array_like
        Packing fraction of the fluid beside the wall.
    dim : {2, 3}
        Dimension d.

    Returns
    -------
    Prediction
        u = 10 % in 3D, 25 % in 2D.
    """
    check_dim(dim)
    value = np.asarray(eta, dtype=np.float64) * _adsorbed(np.asarray(eta, dtype=np.float64), dim)
    return Prediction(value, WRONG[dim] * np.abs(value))


def _adsorbed(e: FloatArray, dim: int) -> FloatArray:
    """Return the adsorption over eta."""
    pressure = compressibility_factor(e, dim).value + e * compressibility_slope(e, dim)  # d(eta Z)/d eta
    if dim == 3:
        tension = (2.0 + 2.0 * e) / (1.0 - e) ** 2 + 2.0 * e * (2.0 + e) / (1.0 - e) ** 3
        tension = 1.5 / math.pi * tension - 3.0 / math.pi * pressure
    else:
        tension = 2.0 / math.pi / (1.0 - e) ** 2 - 2.0 / math.pi * pressure
    return np.asarray(-tension / pressure)


@lru_cache(maxsize=2)
def _excess(dim: int) -> tuple[CubicSpline, float, float]:
    """Return F(eta) on a grid, and at the end of the fluid ln eta + F and its slope in ln eta."""
    from scipy.integrate import cumulative_simpson
    from scipy.interpolate import CubicSpline  # loaded where it is needed: it takes long

    eta = np.linspace(0.0, FLUID_UP_TO[dim], 1001)
    z = compressibility_factor(eta, dim).value
    rising = np.full_like(eta, 2.0 ** (dim - 1))
    rising[1:] = (z[1:] - 1.0) / eta[1:]
    total = cumulative_simpson(rising, x=eta, initial=0.0)
    excess = CubicSpline(eta, z - 1.0 + total)
    end = float(eta[-1])
    return excess, math.log(end) + float(excess(end)), 1.0 + end * float(excess(end, 1))


def _density_of(u: FloatArray, dim: int) -> FloatArray:
    """Return eta where ln eta + F(eta) = u; beyond the fluid a continuation, for solvers."""
    excess, last, slope = _excess(dim)
    inside = np.minimum(u, last)
    log = np.minimum(inside, math.log(FLUID_UP_TO[dim]))  # from the right, Newton's steps go one way
    for _ in range(60):
        eta = np.exp(log)
        step = (log + excess(eta) - inside) / (1.0 + eta * excess(eta, 1))
        log = log - step
        if np.abs(step).max() < 1e-13:
            break
    return np.asarray(np.exp(log + np.maximum(u - last, 0.0) / slope))


@dataclass(frozen=True)
class _Column:
    """The fluid at one temperature: densities at all heights, and sums over them."""

    densities: FloatArray  # (k, points), walls at the sides included
    eta: FloatArray  # (points,), far from the sides
    potential: float
    lifted: FloatArray  # (k,) sums of heights
    at_floor: float  # eta
    at_lid: float
    walls: FloatArray  # (k,) particles in the layers at floor and lid


@dataclass(frozen=True)
class Barometer:
    """A fluid of one diameter and any masses between a floor and a lid, at fixed energy.

    Attributes
    ----------
    counts : tuple of int
        Particles of each species.
    weights : tuple of float
        m g of each, [energy/length].
    area : float
        Cross-section that centres can reach, [length^(d-1)].
    height : float
        h, what centres can reach along gravity, [length].
    diameter : float
        Of all, [length].
    dim : int
        Dimension d.
    freedom : float
        Degrees of freedom of the velocities.
    sides : float, default 0
        Length of the walls around the cross-section, over `area`, [1/length]; 0: periodic.
    """

    counts: tuple[int, ...]
    weights: tuple[float, ...]
    area: float
    height: float
    diameter: float
    dim: int
    freedom: float
    sides: float = 0.0

    def floor(self, temperature: float = 1.0) -> float:
        """Return the packing fraction that hydrostatics has at the floor."""
        return float(self._at(temperature, np.linspace(0.0, self.height, 5)).at_floor)

    def energy(self, temperature: float = 1.0) -> float:
        """Return U(T), kinetic and potential energy above the floor."""
        return (
            0.5 * self.freedom * temperature
            + self._at(temperature, np.linspace(0.0, self.height, 5)).potential
        )

    def temperature(self, energy: float) -> float:
        """Return T of U(T) = E; NaN where that fluid would be frozen at the floor."""
        return _temperature(self, energy)

    def _search(self, energy: float) -> float:
        from scipy.optimize import brentq  # loaded where it is needed: it takes long

        high = math.log(2.0 * energy / self.freedom)  # all of it kinetic
        low = high - 0.5
        while self.energy(math.exp(low)) > energy:
            low -= 0.5
            if self.floor(math.exp(low)) > FLUID_UP_TO[self.dim]:
                return math.nan
        found = brentq(lambda log: self.energy(math.exp(log)) - energy, low, high, xtol=1e-12)
        return math.exp(float(found))

    def kinetic_temperature(self, temperature: float = 1.0) -> float:
        """Return the mean of 2 K/f at energy U(T): T + kT^2 C'/(2 C^2)."""
        low, here, high = (self.energy(temperature * (1.0 + k * STEP)) for k in (-1, 0, 1))
        step = STEP * temperature
        slope, curve = (high - low) / (2.0 * step), (high - 2.0 * here + low) / step**2
        return temperature + 0.5 * temperature**2 * curve / slope**2

    def profile(self, edges: ArrayLike, temperature: float = 1.0) -> Prediction:
        """Return number densities of the species in slices, (k, slices), at the energy U(T).

        Parameters
        ----------
        edges : (slices + 1,) array_like
            Heights, from 0 to h.
        temperature : float
            T, of U(T).

        Returns
        -------
        Prediction
            NaN where the fluid would freeze at the floor. u: of the equation of state, the adsorption, the
            neglected second derivative of the density, fluctuations of composition and of the number above,
            and the next order in 1/N. Within some diameters of floor and lid, where particles lie in layers,
            it does not hold.
        """
        lines = np.asarray(edges, dtype=np.float64)
        step = STEP * temperature
        columns = [self._at(temperature + k * step, lines) for k in (-1, 0, 1)]
        rows = [self._sliced(column.densities, lines) for column in columns]
        energy = [
            0.5 * self.freedom * (temperature + k * step) + columns[k + 1].potential for k in (-1, 0, 1)
        ]
        change, heat = _at_fixed_energy(rows, energy, temperature, step)
        u = self._uncertainty(columns[1], lines, temperature) * rows[1]
        value = rows[1] + change
        if columns[1].at_floor > FLUID_UP_TO[self.dim]:
            value = np.full_like(value, np.nan)
        return Prediction(value, np.hypot(u, change**2 / rows[1] + rows[1] / heat**2))

    def mean_heights(self, edges: ArrayLike, temperature: float = 1.0) -> list[Prediction]:
        """Return the mean height of each species at the energy U(T); slices as for `profile`."""
        lines = np.asarray(edges, dtype=np.float64)
        step, counts, found = STEP * temperature, np.array(self.counts), []
        columns = [self._at(temperature + k * step, lines) for k in (-1, 0, 1)]
        lifted = [column.lifted / counts for column in columns]
        energy = [
            0.5 * self.freedom * (temperature + k * step) + columns[k + 1].potential for k in (-1, 0, 1)
        ]
        change, _ = _at_fixed_energy(lifted, energy, temperature, step)
        profile, middles = self.profile(lines, temperature), (lines[1:] + lines[:-1]) / 2.0
        volumes = self.area * np.diff(lines)
        for k, here in enumerate(lifted[1]):
            # an error of the density moves particles to where the mean is
            missed = (
                float(np.abs(profile.uncertainty[k] * volumes) @ np.abs(middles - here)) / counts[k] / 2.0
            )
            found.append(Prediction(float(here + change[k]), missed))
        return found

    def temperatures(self, edges: ArrayLike, temperature: float = 1.0) -> FloatArray:
        """Return the temperature of the species in slices, (k, slices), at the energy U(T); to order 1/N."""
        lines = np.asarray(edges, dtype=np.float64)
        low, high = (
            self._sliced(self._at(temperature * (1.0 + k * STEP), lines).densities, lines) for k in (-1, 1)
        )
        energies = [self.energy(temperature * (1.0 + k * STEP)) for k in (-1, 1)]
        heat = (energies[1] - energies[0]) / (2 * STEP * temperature)
        rising = np.log(high / low) / (2 * STEP)
        return np.asarray(self.kinetic_temperature(temperature) * (1.0 - rising / heat))

    def bulk(self, edges: ArrayLike, temperature: float = 1.0) -> FloatArray:
        """Return number density of all and pressure in slices, (2, slices), far from walls, at T."""
        lines = np.asarray(edges, dtype=np.float64)
        eta = np.minimum(self._at(temperature, lines).eta, FLUID_UP_TO[self.dim])
        force = temperature * eta * compressibility_factor(eta, self.dim).value
        return np.stack([self._sliced(eta, lines), self._sliced(force, lines)]) / self._volume

    def on_the_lid(self, edges: ArrayLike, temperature: float = 1.0) -> Prediction:
        """Return the force on the lid over the weight, from the density that `profile` has there."""
        lines = np.asarray(edges, dtype=np.float64)
        top = np.append(lines[:-1], [0.5 * (lines[-2] + lines[-1]), lines[-1]])
        column, profile = self._at(temperature, top), self.profile(top, temperature)
        eta = column.at_lid
        state = compressibility_factor(eta, self.dim)
        force = float(temperature * eta * state.value / self._volume * self.area) / self._all
        shift = profile.value[:, -1].sum() / self._sliced(column.densities, top)[:, -1].sum()
        error = float(np.max(profile.uncertainty[:, -1] / profile.value[:, -1])) + abs(shift - 1.0)
        return Prediction(force * shift, force * error)

    @property
    def _all(self) -> float:
        """The weight of all."""
        return float(np.dot(self.counts, self.weights))

    @property
    def _volume(self) -> float:
        """Volume of a particle."""
        return float(packing_fraction(1.0, self.diameter, self.dim))

    def _heights(self, lines: FloatArray) -> FloatArray:
        """Return heights in all slices, at the points of a Gauss-Legendre rule each."""
        nodes = np.polynomial.legendre.leggauss(POINTS)[0]
        return np.asarray((lines[:-1, None] + np.diff(lines)[:, None] * (nodes + 1.0) / 2.0).ravel())

    def _sliced(self, values: FloatArray, lines: FloatArray) -> FloatArray:
        """Return averages over slices, (..., slices)."""
        rule = np.polynomial.legendre.leggauss(POINTS)[1] / 2.0
        return np.asarray(values.reshape(*values.shape[:-1], len(lines) - 1, POINTS) @ rule)

    def _layers(self, eta: FloatArray) -> FloatArray:
        """Return the adsorption over the number density beside the wall, [length]."""
        share = _adsorbed(np.minimum(eta, FLUID_UP_TO[self.dim]), self.dim)
        return np.asarray(share * self._volume / self.diameter ** (self.dim - 1))

    def _at(self, temperature: float, lines: FloatArray, scale: float = 1.0) -> _Column:
        return _column(self, temperature, tuple(lines.tolist()), scale)

    def _solve(self, temperature: float, lines: FloatArray, scale: float) -> _Column:
        """Return the fluid at a temperature, with the particles of floor and lid where they belong."""
        from scipy.optimize import root  # loaded where it is needed: it takes long

        z = self._heights(lines)
        counts = scale * np.array(self.counts, dtype=np.float64)
        loads = np.array(self.weights)[:, None] / temperature
        ends = np.array([0.0, self.height])
        widths = np.diff(lines)

        def column(logs: FloatArray, heights: FloatArray) -> tuple[FloatArray, FloatArray]:
            terms = logs[:, None] - loads * heights
            top = terms.max(axis=0)
            shares = np.exp(terms - top)
            total = shares.sum(axis=0)
            eta = _density_of(top + np.log(total), self.dim)
            return eta, eta / self._volume * shares / total

        def all_of(logs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
            eta, bulk = column(logs, z)
            density = bulk * (1.0 + self.sides * self._layers(eta))
            at_ends, bulk_there = column(logs, ends)
            layers = self.area * self._layers(at_ends) * bulk_there  # (k, 2)
            return eta, density, layers

        def off(logs: FloatArray) -> FloatArray:
            _, density, layers = all_of(logs)
            found = self.area * self._sliced(density, lines) @ widths + layers.sum(axis=1)
            return np.asarray(np.log(found / counts))

        free = loads[:, 0] / -np.expm1(-loads[:, 0] * self.height) * counts / self.area * self._volume
        logs = np.log(free)
        for _ in range(4):  # a start: the density of points that repel each other a little
            logs = logs - 0.5 * off(logs)
        solved = root(off, logs, tol=1e-12).x
        eta, density, layers = all_of(solved)
        at_ends = column(solved, ends)[0]
        lifted = self.area * self._sliced(density * z, lines) @ widths + layers[:, 1] * self.height
        return _Column(
            density,
            eta,
            float(np.array(self.weights) @ lifted),
            lifted,
            float(at_ends[0]),
            float(at_ends[1]),
            layers.sum(axis=1),
        )

    def _uncertainty(self, column: _Column, lines: FloatArray, temperature: float) -> FloatArray:
        """Return the relative uncertainty of the densities at fixed temperature, (slices,)."""
        eta, z = column.eta, self._heights(lines)
        state = compressibility_factor(np.minimum(eta, FLUID_UP_TO[self.dim]), self.dim)
        stiff = state.value + eta * compressibility_slope(np.minimum(eta, FLUID_UP_TO[self.dim]), self.dim)
        # the direct correlation function taken for constant within a diameter
        second = np.gradient(np.gradient(eta, z), z) / eta * self.diameter**2
        gradient = (stiff - 1.0) / (2.0 * (self.dim + 2)) * np.abs(second) / stiff
        rule = np.tile(np.polynomial.legendre.leggauss(POINTS)[1] / 2.0, len(lines) - 1)
        per_log = self.area * float(rule * np.repeat(np.diff(lines), POINTS) @ (eta / stiff)) / self._volume
        missed = WRONG[self.dim] * abs(float(column.walls.sum())) / per_log / stiff
        number = sum(self.counts)
        rows = [
            self._sliced(self._at(temperature, lines, 1.0 + k * STEP).densities.sum(axis=0), lines)
            for k in (-1, 1)
        ]
        here = self._sliced(column.densities.sum(axis=0), lines)
        bend = (rows[1] - 2.0 * here + rows[0]) / (STEP * number) ** 2
        fluctuation = 0.5 * per_log * np.abs(bend) / here
        each = np.hypot(np.hypot(gradient, missed), state.uncertainty / stiff)
        return np.asarray(np.hypot(self._sliced(each, lines), fluctuation))


def _at_fixed_energy(
    values: list[FloatArray], energies: list[float], temperature: float, step: float
) -> tuple[FloatArray, float]:
    """Return what a fixed energy changes of means that are known at T - step, T, T + step; and C."""
    heat = (energies[2] - energies[0]) / (2.0 * step)
    bend = (energies[2] - 2.0 * energies[1] + energies[0]) / step**2
    first = (values[2] - values[0]) / (2.0 * step)
    second = (values[2] - 2.0 * values[1] + values[0]) / step**2
    return -0.5 * temperature**2 / heat * (second - first * bend / heat), heat


@lru_cache(maxsize=64)
def _column(fluid: Barometer, temperature: float, lines: tuple[float, ...], scale: float) -> _Column:
    return fluid._solve(temperature, np.array(lines), scale)


@lru_cache(maxsize=64)
def _temperature(fluid: Barometer, energy: float) -> float:
    return fluid._search(energy)
