"""Analysis of a trajectory: temperatures, velocities beside Maxwell and Boltzmann, drift, g(r)."""

from __future__ import annotations

import datetime
import math
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from analysis import theory
from analysis.distributions import ComponentDistribution, SpeedDistribution
from analysis.maxwell_test import MaxwellTest
from analysis.moments import CONSTANT, VelocityMoments
from analysis.series import SeriesWarning
from analysis.statistics import Estimate, TheoryCheck
from analysis.structure import PairDistribution
from hardspheres.files import Reading
from studies.answer import (
    Answer,
    Column,
    Curves,
    curve_files,
    heading,
    marks_of,
    number,
    sections,
    tidy,
    write_tables,
)
from studies.fluid import Boundary
from studies.gas_in_file import GasInFile
from studies.options import (
    boundary,
    of_labels,
    option,
    options_of,
    own_box,
    units,
    velocities_are,
)
from studies.page.write import Report, write_page
from studies.program import Program
from studies.report import OutputFolder, Screen, figure_style, machine, seconds_taken
from studies.running.ownership import REPORT, SUMMARY

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Analyse", "Findings", "findings"]

FloatArray = NDArray[np.float64]

REACH = 4.0  # of g(r) of particles of unknown radius, in mean distances
LEAST_DEPTH = 0.3  # beyond contact, in diameters, for a contact value
SIGNIFICANT = 1e-3
ALMOST = 0.9  # share of frames that count, from which on there is nothing to say


@dataclass
class Findings:
    """What was measured in a file.

    Attributes
    ----------
    gas : GasInFile
        The gas.
    moments, test, speeds, components
        Estimators of velocities; nothing is added to them where there are none.
    pairs : PairDistribution or None
        Pair distribution, where there can be one.
    notes : list of str
        What could not be measured, and why.
    """

    gas: GasInFile
    moments: VelocityMoments = field(default_factory=VelocityMoments)
    test: MaxwellTest = field(default_factory=MaxwellTest)
    speeds: SpeedDistribution = field(default_factory=SpeedDistribution)
    components: list[ComponentDistribution] = field(default_factory=list)
    pairs: PairDistribution | None = None
    notes: list[str] = field(default_factory=list)

    def __repr__(self) -> str:
        """Return of which file they are, and the moments."""
        return f"<Findings in {self.gas!r}: {self.moments!r}>"

    def begin(self, scene: hs.Scene) -> None:
        """Look at the first frame, and decide what can be measured."""
        if scene.n < 2:
            raise hs.TrajectoryError(f"{self.gas.path} holds one particle; a gas has two or more")
        self.components = [ComponentDistribution(axis) for axis in range(scene.dim)]
        none = self._no_pairs(scene)
        if not none:
            return
        if not self.gas.moving:
            lacking = "all particles are at rest" if self.gas.at_rest else "there are no velocities"
            raise hs.TrajectoryError(f"{self.gas.path}: {lacking}, and there is no g(r): {none}")
        self.notes.append(f"no g(r): {none}")

    def _no_pairs(self, scene: hs.Scene) -> str:
        """Prepare g(r); return why there is none, if so."""
        gas = self.gas
        if not gas.boxed:
            return "the box is not known; --box 10,10,10 gives its edges"
        if not scene.periodic.all():
            return "the box has walls"
        largest, half = 2.0 * float(scene.radii.max()), float(scene.box.min()) / 2.0
        if gas.sized:
            depth = min(1.0, (half / largest - 1.0) * (1.0 - 1e-12))
            if depth < LEAST_DEPTH:
                return f"the box is only {2.0 * half / largest:.3g} diameters wide"
            self.pairs = PairDistribution(depth=depth, bins=max(round(100 * depth), 60))
        else:
            if not gas.points:
                self.notes.append("no radii in the file, so no contact value; --radius 0.5 gives them")
            spacing = float(scene.number_density ** (-1.0 / scene.dim))
            depth = min(REACH * spacing, 0.999 * half) / largest - 1.0
            self.pairs = PairDistribution(depth=depth, window=depth)
        return ""

    def add(self, frame: hs.Frame) -> None:
        """Take in a frame."""
        if self.pairs is not None and self.gas.steady:
            self.pairs.add(frame)
        if not self.gas.moving:
            return
        for each in (self.moments, self.test, self.speeds, *self.components):
            each.add(frame)


def findings(gas: GasInFile) -> Findings:
    """Read a file and measure the gas in it, in one pass.

    Parameters
    ----------
    gas : GasInFile
        Not read yet.

    Raises
    ------
    TrajectoryError, SceneError
        If it cannot be read, or there is nothing to be measured.
    """
    found = Findings(gas)
    for index, frame in enumerate(gas.frames()):
        if index == 0:
            found.begin(gas.scene)
        try:
            found.add(frame)
        except ValueError as error:
            raise hs.TrajectoryError(f"{gas.path}: frame {index}: {error}") from error
    if not gas.steady and found.pairs is not None:
        found.pairs = None
        found.notes.append("no g(r): the box is not the same in all frames")
    return found


@dataclass(frozen=True)
class Analysis(Answer):
    """The answer for one file, with what it comes to, in a sentence or two."""

    verdict: str = ""

    @property
    def label(self) -> str:
        """What is known of the density."""
        if not self.gas.boxed:
            return "box unknown"
        if not self.gas.sized:
            return f"number density {self.gas.scene.number_density:.4g}"
        return "box not constant" if math.isnan(self.gas.packing_fraction) else super().label


@dataclass(frozen=True, kw_only=True)
class Analyse(Program):
    """A table of what the velocities and positions in a file say."""

    name = "analyse"
    explanation = """
    Measures the temperature of each species and along each axis, speeds and velocity components beside
    Maxwell and Boltzmann's law, momentum, drift, and g(r) with its contact value where radii are known.
    FILE is a structure or a trajectory of any program that ASE reads. Frames may be close together: the error
    bars allow for it. A gas that deviates from equilibrium is a result, with exit code 0.
    """
    files = (
        "analysis.csv",
        "frames.csv",
        "speeds.csv",
        "components.csv",
        "pair_distribution.csv",
        "analysis.png",
    )
    reports = True
    resumable = False

    file: str = option("", "Structure or trajectory.", argument=True, metavar="FILE")
    radius: float | dict[str, float] | None = option(None, **of_labels("--radius", "FILE"))
    mass: float | dict[str, float] | None = option(None, **of_labels("--mass", "FILE"))
    units: str | None = units("FILE")
    velocities_are: str | None = velocities_are("FILE")
    box: tuple[float, ...] | None = own_box("FILE")
    boundary: Boundary | None = option(None, **boundary, shown="periodic, with --box")
    dim: int | None = option(
        None,
        "2: FILE is of discs, whose z differ by at most 1e-6 diameters.",
        at_least=2,
        at_most=3,
        shown="3",
    )

    @property
    def which(self) -> str:
        """The name of the file."""
        return Path(self.file).stem

    def reading(self) -> Reading:
        """Return how the file is interpreted."""
        given = self.units or self.velocities_are
        return Reading(self.radius, self.mass, given, self.box, self.boundary, self.dim)

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Read the file, print what was found and write it."""
        began = time.perf_counter()
        out.check(self, resumable=False)
        with screen.working(f"reading {self.file}"):
            found = findings(GasInFile(self.file, self.reading()))
        read = time.perf_counter()
        with screen.working("testing and drawing"), figure_style():
            answer = answer_of(found)
            subject, figures = heading([answer], None), self.figures(answer)
        told = [*legend(found), *(marks_of([answer]) if answer.numbers else [])]
        out.create()
        out.write_csv("analysis.csv", tidy([answer]))
        for name, columns in curve_files([answer]).items():
            out.write_csv(f"{name}.csv", columns)
        for name, figure in figures.items():
            out.save_figure(f"{name}.png", figure, subject)
        summary: dict[str, Any] = {
            "study": self.name,
            "version": hs.__version__,
            "command": self.command,
            "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
            "machine": machine(),
            "options": {each.name: getattr(self, each.name) for each, _ in options_of(self)},
            "frames": found.gas.n_frames,
            "n": found.gas.n,
            "dim": found.gas.dim,
            "states": [answer.summary()],
            "files": sorted({*out.files, REPORT, SUMMARY}),
            "seconds": seconds_taken(began, began, read, work="reading"),
        }
        page = Report(
            name=self.name,
            subject=subject,
            question=self.question,
            answer=[answer.verdict],
            notes=answer.notes,
            figures=figures,
            sections=sections([answer], None),
            legend=told,
            summary=summary,
        )
        write_page(out, page)
        out.write_json(SUMMARY, summary)
        write_tables(screen, [answer], None)
        for sentence in [*told, *answer.notes, answer.verdict]:
            screen.say(sentence)
        screen.say(f"written to {out.path}: {', '.join(summary['files'])}")
        return summary, True

    def figures(self, answer: Analysis) -> Mapping[str, Figure]:
        """Return the one figure."""
        from studies.figures.analyse import figure

        return {"analysis": figure(answer)}


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
    lacking = "all particles are at rest" if gas.at_rest else "no velocities in the file"
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if gas.moving:
            numbers += _numbers(found)
            curves |= _curves(found)
            notes += _of_velocities(found, details)
    with warnings.catch_warnings(record=True) as of_pairs:
        warnings.simplefilter("always")
        if found.pairs is not None:
            numbers += _of_pairs(found)
            curves["pair_distribution"] = _pair_curves(found)
    notes += [*found.notes, *dict.fromkeys(str(each.message) for each in said), *_about_pairs(of_pairs)]
    details["verdict"] = verdict = (
        _of_all(found) if gas.moving else f"{lacking[0].upper()}{lacking[1:]}: nothing but g(r)."
    )
    main = [each.quantity for each in numbers if each.quantity in ("kT", "a2", "g at contact")]
    main += [each.quantity for each in numbers if each.quantity.startswith("KS distance of speeds")]
    hidden = {"found": found}
    return Analysis(gas, numbers, curves, notes, main=main, details=details, hidden=hidden, verdict=verdict)


def _of_all(found: Findings) -> str:
    """Return what all tests of velocities come to."""
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


def _numbers(found: Findings) -> list[TheoryCheck]:
    """Return all numbers about velocities."""
    moments = found.moments
    numbers = [number("kT", moments.temperature), *moments.checks]
    if found.gas.n_frames > 1 and moments.energy_spread > CONSTANT:
        numbers.append(number("change of kT / kT", moments.drift, "no drift", 0.0))
    for axis, momentum in zip("xyz", moments.momentum, strict=False):
        free = momentum.standard_error > 0.0
        if not _vanishes(momentum):
            expected = ("equilibrium", 0.0) if free else ("", None)
            numbers.append(number(f"momentum along {axis}", momentum, *expected))
    return numbers + found.test.checks


def _of_velocities(found: Findings, details: dict[str, Any]) -> list[str]:
    """Return what the numbers mean, in sentences; put what they are made of into the details."""
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
    still = [axis for axis, each in zip("xyz", moments.momentum, strict=False) if _vanishes(each)]
    if still:
        notes.append(f"total momentum is zero along {', '.join(still)}")
    notes.append(
        f"axes: {_verdict(moments.equal_axes, 'one temperature', 'different temperatures')}"
        + (
            f"; species: {_verdict(moments.equal_species, 'one temperature', 'different temperatures')}"
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
            f"speeds{whose}: {_verdict(row[0], 'Maxwell-Boltzmann', 'not Maxwell-Boltzmann')}; components: "
            + ", ".join(f"{axis} p = {_p(p)}" for axis, p in zip("xyz", row[1:], strict=False))
        )
    details |= {
        "effective_frames": counted,
        "frames_tested": found.test.n_tested,
        "velocity_correlation": gas.clock.correlation,
        "ks_p_values": p_values,
        "equal_axes_p": moments.equal_axes,
        "equal_species_p": moments.equal_species,
        "energy_spread": moments.energy_spread,
    }
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
    return [f"not in equilibrium: over the file changes {told} of kT"]


def _vanishes(momentum: Estimate) -> bool:
    return momentum.standard_error == 0.0 and abs(momentum.value) < CONSTANT


def _steadiness(found: Findings) -> list[str]:
    """Return whether the kinetic energy is constant, drifts, or fluctuates."""
    moments = found.moments
    if found.gas.n_frames == 1:
        return []
    if moments.energy_spread < CONSTANT:
        same = f"kinetic energy the same in all frames, to {max(moments.energy_spread, 1e-16):.0e}"
        return [f"{same}: kT has no error bar, and does not drift"]
    change = moments.drift
    per = "" if found.gas.times is not None else " (the file has no times)"
    changes = f"kT changes by {100 * change.value:+.2g} % over the file{per}"
    if math.isnan(change.standard_error):
        return [f"{changes}; too few frames to say if by chance"]
    drifts = "a drift, so that its mean is that of no steady state"
    return [f"{changes}: {_verdict(change.p_value(0.0), 'no more than chance', drifts)}"]


def _verdict(p: float, same: str, different: str) -> str:
    """Return what a p-value says."""
    return f"{same if p >= SIGNIFICANT else different} (p = {_p(p)})"


def _p(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-4 else "0.0001 or less"


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


def _about_pairs(said: Sequence[warnings.WarningMessage]) -> list[str]:
    """Return one sentence for each kind of warning about g(r)."""
    told = {}
    for each in said:
        short = "its frames are too close together, or too few, so that its error bars are lower bounds"
        told[each.category] = short if issubclass(each.category, SeriesWarning) else str(each.message)
    return [f"g(r): {text}" for text in dict.fromkeys(told.values())]


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


def legend(found: Findings) -> Sequence[str]:
    """Return what the quantities are."""
    if not found.gas.moving:
        return []
    tested, count = found.test.n_tested, found.gas.n_frames
    some = f", for {tested} of {count} frames, which are independent" if tested < count else ""
    momentum = "; momentum in units of sqrt(M kT), M the mass of all particles"
    moves = not all(map(_vanishes, found.moments.momentum))
    law = "Maxwell and Boltzmann's law of the same mean velocity and mean square"
    return [
        f"kT = 2 K / D, without the common motion along periodic axes{momentum * moves}",
        f"KS distance: from {law}{some}; theory: its mean and spread at equilibrium",
    ]
