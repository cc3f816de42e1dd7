"""All commands by name: light, so that the command line can list them without loading any."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from studies.program import Program

__all__ = ["QUESTIONS", "study_named"]

QUESTIONS = {
    "thermalise": (
        "studies.thermalisation:Thermalisation",
        "Follow the relaxation of a gas to the Maxwell-Boltzmann distribution.",
    ),
    "pressure": (
        "studies.pressure:EquationOfState",
        "Measure the equation of state of the fluid, beside theory.",
    ),
    "free-path": (
        "studies.free_path:FreePaths",
        "Measure free paths between collisions, beside kinetic theory.",
    ),
    "diffusion": ("studies.diffusion:SelfDiffusion", "Measure self-diffusion, beside Enskog's theory."),
    "transport": (
        "studies.transport:Transport",
        "Measure viscosities, heat conductivity and mutual diffusion, beside Enskog's theory.",
    ),
    "mixture": (
        "studies.mixture:Mixture",
        "Follow the temperature equilibration of two species, beside kinetic theory.",
    ),
    "expansion": (
        "studies.expansion:Expansion",
        "Let a gas out of half of a box, beside an ideal gas, and back by reversing all velocities.",
    ),
    "barometer": (
        "studies.barometer:BarometerStudy",
        "Measure density, temperature and pressure at each height under gravity, beside hydrostatics.",
    ),
    "drop": (
        "studies.drop:Drop",
        "Let balls fall into a box, and follow them to the Maxwell-Boltzmann distribution.",
    ),
    "lorentz": (
        "studies.lorentz:Lorentz",
        "Follow a particle among fixed obstacles: free path, diffusion and chaos, beside theory.",
    ),
    "melting": (
        "studies.melting:Melting",
        "Follow discs where they melt: pressure and hexatic order from two starts, beside literature.",
    ),
    "combine": (
        "studies.combine:Combine",
        "Merge finished runs of one study with different seeds.",
    ),
    "view": ("studies.viewer.command:View", "Watch the gas in a file in a browser, every collision."),
    "analyse": (
        "studies.analyse.command:Analyse",
        "Analyse a trajectory of any program, its velocities beside Maxwell and Boltzmann's.",
    ),
    "bench": (
        "studies.benchmarks.command:Benchmark",
        "Measure collisions per second, beside another engine.",
    ),
    "accuracy": (
        "studies.validation.accuracy:Accuracy",
        "Compare speed and error with two time-stepping programs.",
    ),
    "accuracy-tables": (
        "studies.validation.tables:AccuracyTables",
        "Measure every observable beside the best number that is known for it, with its cost.",
    ),
    "calibration": (
        "studies.validation.calibration:Calibrations",
        "Test the error bars: (value - truth) / standard error of every estimator, over many short runs.",
    ),
    "hard-cases": (
        "studies.validation.hard_cases:HardCases",
        "Test the engine on hard cases with exact answers.",
    ),
    "verify": (
        "studies.validation.verify:Verify",
        "Compare this machine with the results kept in the package, to the last bit.",
    ),
    "soak": (
        "studies.validation.soak:Soak",
        "Run two gases for very long and test what must not change.",
    ),
}
"""Where each is found, and its question."""


def study_named(name: str) -> type[Program]:
    """Return the class of a command."""
    module, _, kind = QUESTIONS[name][0].partition(":")
    found: Any = getattr(importlib.import_module(module), kind)
    return found  # type: ignore[no-any-return]
