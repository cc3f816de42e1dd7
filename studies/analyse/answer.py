"""Numbers and curves of a file that was read."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from analysis import theory
from analysis.statistics import TheoryCheck
from studies.analyse.findings import Findings
from studies.analyse.sentences import about_pairs, about_velocities, vanishes, verdict
from studies.answer import Answer, Column, Curves, number

__all__ = ["Analysis", "answer_of"]


@dataclass(frozen=True, repr=False)
class Analysis(Answer):
    """The answer for one file."""

    @property
    def verdict(self) -> str:
        """What it comes to."""
        return str(self.details["verdict"])

    @property
    def label(self) -> str:
        """What is known of the density."""
        if not self.gas.boxed:
            return "box unknown"
        if not self.gas.sized:
            return f"number density {self.gas.scene.number_density:.4g}"
        return "box not constant" if math.isnan(self.gas.packing_fraction) else super().label


def answer_of(found: Findings) -> Analysis:
    """Return numbers, curves and sentences of a file that was read.

    Parameters
    ----------
    found : Findings
        What was measured.
    """
    gas = found.gas
    numbers: list[TheoryCheck] = []
    curves: dict[str, Curves] = {}
    notes = [*gas.notes]
    details: dict[str, Any] = {"file": gas.path, "frames": gas.n_frames, "boundary": list(gas.scene.boundary)}
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if gas.moving:
            numbers += _numbers(found)
            curves |= _curves(found)
            notes += about_velocities(found)
            details |= _details(found)
    with warnings.catch_warnings(record=True) as of_pairs:
        warnings.simplefilter("always")
        if found.pairs is not None:
            numbers += _of_pairs(found)
            curves["pair_distribution"] = _pair_curves(found)
    notes += [*found.notes, *dict.fromkeys(str(each.message) for each in said), *about_pairs(of_pairs)]
    details["verdict"] = verdict(found)
    main = [each.quantity for each in numbers if each.quantity in ("kT", "a2", "g at contact")]
    main += [each.quantity for each in numbers if each.quantity.startswith("KS distance of speeds")]
    return Analysis(gas, numbers, curves, notes, main=main, details=details, hidden={"found": found})


def _details(found: Findings) -> dict[str, Any]:
    """Return what the sentences are made of, for the summary."""
    moments = found.moments
    return {
        "effective_frames": moments.effective_frames,
        "frames_tested": found.test.n_tested,
        "velocity_correlation": found.gas.clock.correlation,
        "ks_p_values": found.test.p_values,
        "equal_axes_p": moments.equal_axes,
        "equal_species_p": moments.equal_species,
        "energy_spread": moments.energy_spread,
    }


def _numbers(found: Findings) -> list[TheoryCheck]:
    """Return all numbers about velocities."""
    moments = found.moments
    numbers = [number("kT", moments.temperature), *moments.checks]
    if found.gas.n_frames > 1 and not moments.energy_conserved:
        numbers.append(number("change of kT / kT", moments.drift, "no drift", 0.0))
    for axis, momentum in zip("xyz", moments.momentum, strict=False):
        free = momentum.standard_error > 0.0
        if not vanishes(momentum):
            expected = ("equilibrium", 0.0) if free else ("", None)
            numbers.append(number(f"momentum along {axis}", momentum, *expected))
    return numbers + found.test.checks


def _of_pairs(found: Findings) -> list[TheoryCheck]:
    """Return contact values beside theory."""
    pairs, gas = found.pairs, found.gas
    assert pairs is not None
    if not gas.sized:
        return []
    its, dim = pairs.gas, gas.dim
    several = len(its.sizes) > 1
    if several:
        expected = theory.mixture_contact_values(its.sizes / its.volume, its.diameters, dim)
        missed = theory.mixture_contact_uncertainty(its.diameters, dim)
        name = "Santos-Yuste-Lopez de Haro"
    else:
        z = theory.finite_size_compressibility(its.packing_fraction, dim, its.n, "canonical")
        slope = 2.0 ** (dim - 1) * its.packing_fraction
        expected = np.array([[(float(z.value) - 1.0) / slope]])
        name = "Kolafa-Labik-Malijevsky" if dim == 3 else "virial series resummed"
    numbers = []
    for (i, j), measured in pairs.contact.items():
        value = float(expected[i, j])
        u = missed * (value - 1.0) if several else float(z.uncertainty) / slope
        quantity = f"g at contact{f', species {i + 1} and {j + 1}' if several else ''}"
        numbers.append(number(quantity, measured, name, theory.Prediction(value, u)))
    return [*numbers, pairs.check]


def _curves(found: Findings) -> dict[str, Curves]:
    """Return frames, speeds and components as files."""
    moments, speeds, times = found.moments, found.speeds, found.gas.times
    kinds = len(moments.gas.sizes)
    rows = moments.table
    index = rows.pop("index")
    when = index if times is None else np.interp(index, np.arange(len(times)), times)
    nothing = np.full(len(when), math.nan)
    frames = Curves(
        {"frame" if times is None else "time": when},
        {name: Column(values, nothing) for name, values in rows.items()},
    )

    def histogram(measured: Any, name: str) -> Curves:
        columns = {
            (f"{name}_{k + 1}" if kinds > 1 else name): Column(
                measured.density[k],
                measured.density_error[k],
                measured.theory,
                np.zeros(len(measured.theory)),
            )
            for k in range(kinds)
        }
        return Curves({"reduced_velocity": (measured.edges[1:] + measured.edges[:-1]) / 2}, columns)

    parts = [histogram(each, "xyz"[axis]) for axis, each in enumerate(found.components)]
    components = Curves(parts[0].axes, {name: each for part in parts for name, each in part.columns.items()})
    return {"frames": frames, "speeds": histogram(speeds, "density"), "components": components}


def _pair_curves(found: Findings) -> Curves:
    pairs = found.pairs
    assert pairs is not None
    r, g, error = pairs.r, pairs.g, pairs.g_error
    names = ["g" if len(pairs.pairs) == 1 else f"g_{i + 1}{j + 1}" for i, j in pairs.pairs]
    axes = (
        {"r": r[0]} if len(names) == 1 else {f"r_{name[2:]}": own for name, own in zip(names, r, strict=True)}
    )
    return Curves(axes, {name: Column(g[k], error[k]) for k, name in enumerate(names)})
