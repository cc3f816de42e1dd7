"""Real gases as hard spheres: which diameter and mass, and how dense they are at a temperature and pressure.

Units are nm, ps and u (the atomic mass constant): speeds come in nm/ps = km/s, diffusion coefficients in
nm^2/ps = mm^2/s, energies in u nm^2/ps^2, pressures in u/(nm ps^2) = `PASCAL` Pa.

A molecule has no one diameter. Two usual choices are in the table:

- ``"viscosity"``: the spheres have the viscosity of the gas, mu = 1.016034 x 5/(16 d^2) sqrt(m kT/pi)
  (Chapman and Cowling, The Mathematical Theory of Non-Uniform Gases, 3rd ed., 1970, chapter 10; the factor is
  the converged Sonine series). Molecules are soft, so that d falls with temperature: that of argon by 7 %
  from 200 to 300 K. Viscosities, in uPa s at low pressure: CRC Handbook of Chemistry and Physics, section 6,
  "Viscosity of gases" (Huber and Harvey), three digits at 200, 300, 400 and 500 K, between which log mu is
  linear in log T. Their uncertainty is said to be below 3 %; that of d is half of it.
- ``"kinetic"``: the narrowest pore that molecules pass (Breck, Zeolite Molecular Sieves, Wiley 1974, p. 636).
  What is long and thin, as CO2, is slim there.

Atomic weights: Prohaska and others 2022, doi 10.1515/pac-2019-0603, abridged to five digits.
"""

import math
from dataclasses import dataclass
from difflib import get_close_matches
from numbers import Real
from typing import Any

from hardspheres.compression import EASY, compressed_gas
from hardspheres.errors import SceneError
from hardspheres.initial import random_gas
from hardspheres.scene import Scene
from hardspheres.velocities import Seed

__all__ = ["DIAMETERS", "FREEZING", "GASES", "PASCAL", "RealGas", "real_gas"]

BOLTZMANN = 1.380649e-23  # J/K, exact
ATOMIC_MASS = 1.66053906660e-27  # kg, CODATA 2018
PASCAL = ATOMIC_MASS / (1e-9 * 1e-12**2)
"""Pascals in a u/(nm ps^2)."""
KELVIN = BOLTZMANN / (ATOMIC_MASS * 1e3**2)
"""Boltzmann's constant, u nm^2/ps^2 per kelvin."""

TEMPERATURES = (200.0, 300.0, 400.0, 500.0)  # K, of the viscosities
SONINE = 1.016034  # of the viscosity of hard spheres
DIAMETERS = ("viscosity", "kinetic")

FREEZING = 0.494
"""Packing fraction up to which the fluid of hard spheres counts as the state in equilibrium. They freeze at
0.492 (Fernandez et al. 2012, doi 10.1103/PhysRevLett.108.165701; older work has 0.494)."""


@dataclass(frozen=True)
class Substance:
    """What is known of a gas.

    Attributes
    ----------
    name : str
        In English.
    mass : float
        Of a molecule, u.
    viscosities : tuple of float
        At `TEMPERATURES`, uPa s.
    kinetic : float
        Kinetic diameter, nm.
    """

    name: str
    mass: float
    viscosities: tuple[float, float, float, float]
    kinetic: float

    @property
    def atomic(self) -> bool:
        """Whether its particles are atoms."""
        return self.name in ("helium", "neon", "argon", "krypton", "xenon")


GASES = {
    "He": Substance("helium", 4.0026, (15.1, 19.9, 24.3, 28.3), 0.26),
    "Ne": Substance("neon", 20.180, (24.1, 31.9, 38.6, 44.8), 0.275),
    "Ar": Substance("argon", 39.95, (15.9, 22.7, 28.6, 33.9), 0.34),
    "Kr": Substance("krypton", 83.798, (17.4, 25.5, 32.9, 39.6), 0.36),
    "Xe": Substance("xenon", 131.29, (15.7, 23.2, 30.5, 37.2), 0.396),
    "H2": Substance("hydrogen", 2.0160, (6.8, 8.9, 10.9, 12.8), 0.289),
    "N2": Substance("nitrogen", 28.014, (12.9, 17.9, 22.2, 26.1), 0.364),
    "O2": Substance("oxygen", 31.998, (14.7, 20.7, 25.8, 30.5), 0.346),
    "CO2": Substance("carbon dioxide", 44.009, (10.1, 15.0, 19.7, 24.0), 0.33),
    "CH4": Substance("methane", 16.043, (7.7, 11.1, 14.2, 17.0), 0.38),
}


@dataclass(frozen=True)
class RealGas:
    """A gas of hard spheres with the mass of a molecule and a diameter that stands for it.

    It has no attraction, which real molecules have, and no inner motion: p = rho kT Z with the Z of hard
    spheres. That of argon at 273.15 K and 101325 Pa is 1.003, the real one 0.999.

    Parameters
    ----------
    formula : str
        One of `GASES`.
    temperature : float
        In kelvin.
    pressure : float
        In Pa.
    size : "viscosity", "kinetic" or float
        Which diameter, or how many nm.

    Attributes
    ----------
    diameter : float
        d, in nm.

    Raises
    ------
    SceneError
        For a gas that is not in the table; a temperature, pressure or diameter that is not positive and
        finite; a temperature whose viscosity is not in the table; a pressure at which these spheres freeze.
    """

    formula: str
    temperature: float = 273.15
    pressure: float = 101325.0
    size: float | str = "viscosity"

    def __post_init__(self) -> None:
        """Refuse what is no gas."""
        if not isinstance(self.formula, str) or self.formula not in GASES:
            raise SceneError(f"{_unknown(self.formula)}; known are {', '.join(GASES)}")
        for name, unit in (("temperature", "kelvin"), ("pressure", "Pa")):
            value = getattr(self, name)
            if not _positive(value):
                raise SceneError(f"{name} is {value!r}; it must be positive and finite, in {unit}")
        if not (self.size in DIAMETERS if isinstance(self.size, str) else _positive(self.size, 0.01, 10.0)):
            raise SceneError(
                f'diameter is {self.size!r}; it must be "viscosity", "kinetic", or nm between 0.01 and 10'
            )
        low, high = TEMPERATURES[0], TEMPERATURES[-1]
        if self.size == "viscosity" and not low <= self.temperature <= high:
            raise SceneError(
                f"the diameter of {self.formula} from its viscosity is known from {low:g} to {high:g} K, not "
                f'at {self.temperature:g} K; give a diameter in nm, or "kinetic"'
            )
        most = _reduced_pressure(FREEZING) * self.kT / self.diameter**3 * PASCAL
        if self.pressure > most:
            raise SceneError(
                f"hard spheres of diameter {self.diameter:.4g} nm freeze at {_rounded_down(most)} Pa and "
                f"{self.temperature:g} K, and the pressure is {self.pressure:g} Pa; ask for less"
            )

    @property
    def substance(self) -> Substance:
        """What the table says of it."""
        return GASES[self.formula]

    @property
    def mass(self) -> float:
        """Mass m of a molecule, in u."""
        return self.substance.mass

    @property
    def kT(self) -> float:
        """Thermal energy, in u nm^2/ps^2."""
        return KELVIN * float(self.temperature)

    @property
    def viscosity(self) -> float:
        """Viscosity of the real gas at low pressure, in Pa s: interpolated between `TEMPERATURES`."""
        known = self.substance.viscosities
        k = sum(self.temperature > edge for edge in TEMPERATURES[1:-1])
        between = math.log(self.temperature / TEMPERATURES[k]) / math.log(
            TEMPERATURES[k + 1] / TEMPERATURES[k]
        )
        return float(1e-6 * known[k] * (known[k + 1] / known[k]) ** between)

    @property
    def diameter(self) -> float:
        """Diameter d of a sphere, in nm."""
        if self.size == "viscosity":
            thermal = math.sqrt(self.mass * ATOMIC_MASS * BOLTZMANN * self.temperature / math.pi)
            return 1e9 * math.sqrt(SONINE * 5.0 / 16.0 * thermal / self.viscosity)
        return self.substance.kinetic if isinstance(self.size, str) else float(self.size)

    @property
    def packing_fraction(self) -> float:
        """Packing fraction at which hard spheres have this pressure (Carnahan and Starling 1969)."""
        wanted = float(self.pressure) / PASCAL * self.diameter**3 / self.kT
        eta = FREEZING
        for _ in range(20):  # Newton's method from above falls to the root: p d^3 / kT is convex
            eta -= (_reduced_pressure(eta) - wanted) / _slope(eta)
        return eta

    @property
    def number_density(self) -> float:
        """Molecules per nm^3."""
        return self.packing_fraction / (math.pi / 6.0 * self.diameter**3)


def _positive(value: Any, low: float = 0.0, high: float = math.inf) -> bool:
    """Return whether this is a number between two, both excluded."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return low < float(value) < high
    except OverflowError:  # a Python integer beyond all floats
        return False


def _unknown(formula: object) -> str:
    """Return that this gas is not known, and which one may be meant."""
    words = {name.lower(): gas for gas, its in GASES.items() for name in (gas, its.name)}
    near = get_close_matches(str(formula).lower(), words, n=1)
    meant = f" (did you mean {words[near[0]]}?)" if near else ""
    return f"the gas {formula!r} is not in the table{meant}"


def _reduced_pressure(eta: float) -> float:
    """Return p d^3 / kT of hard spheres (Carnahan and Starling 1969, doi 10.1063/1.1672048)."""
    return 6.0 / math.pi * eta * (1.0 + eta + eta**2 - eta**3) / (1.0 - eta) ** 3


def _slope(eta: float) -> float:
    """Return the derivative of `_reduced_pressure`."""
    return 6.0 / math.pi * (1.0 + 4.0 * eta + 4.0 * eta**2 - 4.0 * eta**3 + eta**4) / (1.0 - eta) ** 4


def _rounded_down(value: float) -> str:
    """Return a number in three digits that is not larger."""
    if value == 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.floor(value / step) * step:.3g}"


def real_gas(
    formula: str,
    *,
    temperature: float = 273.15,
    pressure: float = 101325.0,
    n: int = 4000,
    diameter: float | str = "viscosity",
    boundary: str | tuple[str, ...] = "periodic",
    velocities: str = "maxwell",
    seed: Seed,
) -> Scene:
    """Make a real gas as hard spheres, in nm, ps and u: speeds in km/s, energies in u nm^2/ps^2.

    The density follows from temperature and pressure by the equation of state of hard spheres; real molecules
    also attract each other. Which diameter stands for a molecule is a choice: argon at 273.15 K and 101325 Pa
    has a mean free path of 61.9 nm with that from its viscosity, 72.5 nm with the kinetic one, and both are
    in use. `hardspheres.gases` says where the numbers come from.

    Parameters
    ----------
    formula : str
        He, Ne, Ar, Kr, Xe, H2, N2, O2, CO2 or CH4.
    temperature : float
        In kelvin; with the diameter from the viscosity from 200 to 500.
    pressure : float
        In Pa, of a large box; one of n particles, whose momentum is zero, has 1/n less.
    n : int
        Number of particles.
    diameter : "viscosity", "kinetic" or float
        Which one, or how many nm.
    boundary, velocities, seed
        As in `random_gas`.

    Returns
    -------
    Scene
        The gas. A dense one is made by `compressed_gas`.

    Raises
    ------
    SceneError
        When an argument is not as above, or hard spheres freeze at this pressure.
    """
    gas = RealGas(formula, temperature, pressure, diameter)
    eta = gas.packing_fraction
    make = compressed_gas if eta > EASY[3] else random_gas
    return make(
        n=n,
        packing_fraction=eta,
        boundary=boundary,
        velocities=velocities,
        temperature=gas.kT,
        radii=gas.diameter / 2.0,
        masses=gas.mass,
        seed=seed,
    )
