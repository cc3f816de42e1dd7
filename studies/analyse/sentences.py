"""What the numbers mean, in sentences."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence

import numpy as np

from analysis.moments import FIXED
from analysis.series import SeriesWarning
from analysis.statistics import Estimate
from studies.analyse.findings import Findings

__all__ = ["about_pairs", "about_velocities", "legend", "vanishes", "verdict"]

SIGNIFICANT = 1e-3  # p-value below which there is a difference
ALMOST = 0.9  # share of frames that count, from which on there is nothing to say


def verdict(found: Findings) -> str:
    """Return what all tests of velocities come to."""
    if not found.gas.moving:
        lacking = "All particles are at rest" if found.gas.at_rest else "No velocities in the file"
        return f"{lacking}: nothing but g(r)."
    moments, several = found.moments, len(found.moments.gas.sizes) > 1
    amiss = []
    if moments.equal_axes < SIGNIFICANT:
        amiss.append("axes have different temperatures")
    if several and moments.equal_species < SIGNIFICANT:
        amiss.append("species have different temperatures")
    for kind, row in enumerate(found.test.p_values):
        whose = f" of species {kind + 1}" if several else ""
        odd = [name for name, p in zip(("speeds", *"xyz"), row, strict=False) if p < SIGNIFICANT]
        if odd:
            what = ", ".join(name if name == "speeds" else f"velocities along {name}" for name in odd)
            amiss.append(f"{what}{whose} are not Maxwell and Boltzmann's")
    for each in moments.checks:
        if each.quantity.startswith("a2") and each.p_value < SIGNIFICANT:
            amiss.append(f"{each.quantity} is {each.z:+.1f} standard errors from equilibrium's")
    many = found.gas.n_frames > 1
    if many and moments.drift.p_value(0.0) < SIGNIFICANT:
        amiss.append("kT drifts")
    if many and any(change.p_value(0.0) < SIGNIFICANT for change in moments.share_drifts.values()):
        amiss.append("temperatures drift apart, or together")
    if amiss:
        return f"This gas is not in equilibrium: {'; '.join(amiss)}."
    return "Nothing in the velocities tells this gas from one in equilibrium."


def about_velocities(found: Findings) -> list[str]:
    """Return what the numbers about velocities mean."""
    gas, moments = found.gas, found.moments
    frames, counted = gas.n_frames, moments.effective_frames
    labels = moments.gas.labels
    several = len(labels) > 1
    p_values = found.test.p_values
    notes = []
    if several:
        notes.append("species: " + "; ".join(f"{k}: {label}" for k, label in enumerate(labels, 1)))
    if frames == 1:
        notes.append("one frame: errors of velocities are the noise of so many particles at equilibrium")
    elif counted < ALMOST * frames:
        apart = round(gas.clock.s / (frames - 1), 6)
        notes.append(
            f"frames are {apart:.2g} mean free times apart (the velocities of successive ones are correlated "
            f"by {gas.clock.correlation:.2g}): {frames} frames count as {counted:.2g}, and error bars allow "
            "for it"
        )
    notes += _steadiness(found) + (_drifting(found) if frames > 1 else [])
    still = [axis for axis, each in zip("xyz", moments.momentum, strict=False) if vanishes(each)]
    if still:
        notes.append(f"total momentum is zero along {', '.join(still)}")
    notes.append(
        f"axes: {_told(moments.equal_axes, 'one temperature', 'different temperatures')}"
        + (
            f"; species: {_told(moments.equal_species, 'one temperature', 'different temperatures')}"
            if several
            else ""
        )
    )
    for kind, row in enumerate(p_values):
        whose = f" of species {kind + 1}" if several else ""
        if np.isnan(row[0]):
            notes.append(f"too few particles{whose} for a distribution of speeds")
            continue
        notes.append(
            f"speeds{whose}: {_told(row[0], 'Maxwell-Boltzmann', 'not Maxwell-Boltzmann')}; components: "
            + ", ".join(f"{axis} p = {_p(p)}" for axis, p in zip("xyz", row[1:], strict=False))
        )
    return notes


def _drifting(found: Findings) -> list[str]:
    """Return which temperatures change relative to that of all, in a sentence."""
    changed = {
        name: change
        for name, change in found.moments.share_drifts.items()
        if change.p_value(0.0) < SIGNIFICANT
    }
    if not changed:
        return []
    told = ", ".join(f"{name} by {100 * change.value:+.2g} %" for name, change in changed.items())
    return [f"changes over the file, relative to kT: {told}"]


def vanishes(momentum: Estimate) -> bool:
    """Return whether a momentum is conserved, and zero."""
    return momentum.standard_error == 0.0 and abs(momentum.value) < FIXED


def _steadiness(found: Findings) -> list[str]:
    """Return whether the kinetic energy is constant, drifts, or fluctuates."""
    moments = found.moments
    if found.gas.n_frames == 1:
        return []
    if moments.energy_conserved:
        same = f"kinetic energy the same in all frames, to {max(moments.energy_spread, 1e-16):.0e}"
        return [f"{same}: kT has no error bar, and does not drift"]
    change = moments.drift
    per = "" if found.gas.times is not None else " (the file has no times)"
    changes = f"kT changes by {100 * change.value:+.2g} % over the file{per}"
    if math.isnan(change.standard_error):
        return [f"{changes}; too few frames to say if by chance"]
    drifts = "a drift, so that its mean is that of no steady state"
    return [f"{changes}: {_told(change.p_value(0.0), 'no more than chance', drifts)}"]


def _told(p: float, same: str, different: str) -> str:
    """Return what a p-value says."""
    return f"{same if p >= SIGNIFICANT else different} (p = {_p(p)})"


def _p(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "0.0001 or less"


def about_pairs(said: Sequence[warnings.WarningMessage]) -> list[str]:
    """Return one sentence for each kind of warning about g(r)."""
    told = {}
    for each in said:
        short = "its frames are too close together, or too few, so that its error bars are lower bounds"
        told[each.category] = short if issubclass(each.category, SeriesWarning) else str(each.message)
    return [f"g(r): {text}" for text in dict.fromkeys(told.values())]


def legend(found: Findings) -> Sequence[str]:
    """Return what the quantities are."""
    if not found.gas.moving:
        return []
    tested, count = found.test.n_tested, found.gas.n_frames
    some = f", for {tested} of {count} frames, which are independent" if tested < count else ""
    momentum = "; momentum in units of sqrt(M kT), M the mass of all particles"
    moves = not all(map(vanishes, found.moments.momentum))
    law = "Maxwell and Boltzmann's law of the same mean velocity and mean square"
    return [
        f"kT = 2 K / D, without the common motion along periodic axes{momentum * moves}",
        f"KS distance: from {law}{some}; theory: its mean and spread at equilibrium",
    ]
