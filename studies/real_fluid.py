"""Real gases in studies: their options, and the one place where numbers get units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from analysis import theory
from analysis.statistics import TheoryCheck
from hardspheres.errors import SceneError
from hardspheres.gases import DIAMETERS, GASES, PASCAL, RealGas
from studies.fluid import Fluid
from studies.options import OptionError, option, options_of, positive

__all__ = ["UNITS", "RealFluid", "real_gas_of"]

UNITS = {
    "mean free path": ("nm", 1.0),
    "mean free time": ("ps", 1.0),
    "mean speed": ("m/s", 1e3),
    "pressure": ("Pa", PASCAL),
    "D of this box": ("mm^2/s", 1.0),
    "correction for the box": ("mm^2/s", 1.0),
    "D": ("mm^2/s", 1.0),
    "decay rate of a2 in time": ("1/ns", 1e3),
}
"""Unit of each measured number, and how many of them are one in nm, ps and u."""

_EXCLUDED = {  # options that make no sense beside --gas, and why
    "packing_fraction": "whose density follows from its temperature and pressure",
    "packing_fractions": "whose density follows from its temperature and pressure",
    "dim": "which has three dimensions",
    "mass_ratio": "which has one kind of molecule",
    "diameter_ratio": "which has one kind of molecule",
    "fraction": "which has one kind of molecule",
    "source": "which makes its own structure",
}


def gas() -> Any:
    """Return the field for the formula of a real gas."""
    return option(
        None,
        f"A real gas as hard spheres, in nm, ps, m/s and Pa: {', '.join(GASES)}.",
        shown="reduced units",
        metavar="FORMULA",
        autocompletion=lambda: list(GASES),
    )


def temperature() -> Any:
    """Return the field for the temperature of a real gas."""
    its = positive("--temperature", "the temperature of --gas in kelvin")
    return option(None, "With --gas: its temperature in kelvin.", shown="273.15", **its)


def pressure() -> Any:
    """Return the field for the pressure of a real gas."""
    its = positive("--pressure", "the pressure of --gas in Pa")
    return option(None, "With --gas: its pressure in Pa.", shown="101325", **its)


def _diameter(text: str) -> str | float:
    if text in DIAMETERS:
        return text
    try:
        return float(text)
    except ValueError:
        words = " or ".join(DIAMETERS)
        raise OptionError(f"--diameter {text} is not known; it can be {words}, or a number of nm") from None


def diameter() -> Any:
    """Return the field for the diameter of the molecules of a real gas."""
    return option(
        None,
        "With --gas: which diameter its molecules have: viscosity (from that of the gas), kinetic (of the "
        "pores that they pass), or a number of nm.",
        shown="viscosity",
        parser=_diameter,
        metavar="WORD|NUMBER",
        autocompletion=lambda: list(DIAMETERS),
    )


def real_gas_of(study: Any, own: Sequence[str] = ("temperature", "pressure", "diameter")) -> RealGas | None:
    """Return the gas of --gas, None where none is asked for; SceneError for options that exclude each other.

    Parameters
    ----------
    study : Study
        With the fields `gas`, `temperature`, `pressure` and `diameter`.
    own : sequence of str
        Those that make no sense without a gas.
    """
    if study.gas is None:
        for name in own:
            if getattr(study, name) is not None:
                raise SceneError(f"--{name} goes with --gas, as in --gas Ar; without it units are reduced")
        return None
    for each, its in options_of(study):
        harmless = (each.default, 3 if each.name == "dim" else each.default)
        if each.name in _EXCLUDED and getattr(study, each.name) not in harmless:
            raise SceneError(f"{its.named(each.name)} has no effect with --gas, {_EXCLUDED[each.name]}")
    given = {"temperature": study.temperature, "pressure": study.pressure, "size": study.diameter}
    return RealGas(study.gas, **{name: value for name, value in given.items() if value is not None})


def scaled(found: TheoryCheck, quantity: str, factor: float, in_theory: float | None = None) -> TheoryCheck:
    """Return a number times a factor under another name, its theory times the same or a factor of its own."""
    expected, measured = factor if in_theory is None else in_theory, found.measured
    return TheoryCheck(
        quantity,
        found.theory,
        replace(measured, value=measured.value * factor, standard_error=measured.standard_error * factor),
        found.expected * expected,
        found.uncertainty * expected,
    )


def in_units(numbers: Iterable[TheoryCheck]) -> list[TheoryCheck]:
    """Return numbers measured in nm, ps and u in the units of `UNITS`, which their names tell then."""
    return [
        scaled(found, named(found.quantity), UNITS[found.quantity][1]) if found.quantity in UNITS else found
        for found in numbers
    ]


def named(quantity: str) -> str:
    """Return the name of a measured number of a real gas: with its unit, where it has one."""
    return f"{quantity} [{UNITS[quantity][0]}]" if quantity in UNITS else quantity


def mean_free_path(gas: RealGas) -> float:
    """Return the mean free path of a gas in Enskog's theory, in nm."""
    return float(theory.mean_free_path(gas.packing_fraction, 3, gas.diameter))


def words_of(n: int, gas: RealGas) -> str:
    """Return so many molecules of a gas in words."""
    kind = "atoms" if gas.substance.atomic else "molecules"
    return (
        f"{n} {gas.formula} {kind}, {gas.temperature:g} K, {gas.pressure:g} Pa, "
        f"diameter {gas.diameter:.4g} nm"
    )


def remarks_of(gas: RealGas) -> list[str]:
    """Return which diameter a gas has and what another would change, and the units of all files."""
    told = f"{_diameter_of(gas)}, gives a mean free path of {mean_free_path(gas):.4g} nm"
    for size in DIAMETERS:
        try:
            other = replace(gas, size=size)
        except SceneError:  # it is not known at this temperature, or these spheres are frozen
            continue
        if size != gas.size:
            told += f"; {_diameter_of(other)}, would give {mean_free_path(other):.4g} nm"
    thermal, mean = 1e3 * math.sqrt(gas.kT / gas.mass), 1e3 * theory.mean_speed(3, gas.mass, gas.kT)
    told += f"; sqrt(kT/m) is {thermal:.4g} m/s, the mean speed in equilibrium {mean:.4g} m/s"
    return [told, "in the files lengths are in nm, times in ps, masses in u, where no name says more"]


def _diameter_of(gas: RealGas) -> str:
    words = {
        "viscosity": "the diameter from the viscosity (CRC Handbook, Viscosity of gases)",
        "kinetic": "the kinetic diameter (Breck 1974)",
    }
    return f"{words.get(str(gas.size), 'the diameter that was given')}, {gas.diameter:.4g} nm"


@dataclass(frozen=True)
class RealFluid(Fluid):
    """A real gas as hard spheres, in nm, ps and u.

    Attributes
    ----------
    real : RealGas
        Which one, where.
    """

    real: RealGas = field(kw_only=True)

    @classmethod
    def of(cls, n: int, gas: RealGas) -> RealFluid:
        """Return so many molecules of a gas in a periodic box."""
        return cls(n, 3, gas.packing_fraction, real=gas)

    @property
    def units(self) -> dict[str, float]:
        """Diameter [nm], mass [u] and kT [u nm^2/ps^2]."""
        return {"diameter": self.real.diameter, "mass": self.real.mass, "temperature": self.real.kT}

    def named(self, quantity: str) -> str:
        """Return the name of a measured number in an answer: with its unit, where it has one."""
        return named(quantity)

    def in_units(self, numbers: Iterable[TheoryCheck]) -> list[TheoryCheck]:
        """Return numbers converted to the units of `UNITS`."""
        return in_units(numbers)

    @property
    def remarks(self) -> list[str]:
        """Which diameter it has, and what another would change."""
        return remarks_of(self.real)

    def __str__(self) -> str:
        """Return the gas in words."""
        return f"{words_of(self.n, self.real)}, periodic box"
