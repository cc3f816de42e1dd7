"""The console script `hardspheres`: parses options, runs a study, returns an exit code.

Exit codes are those of `studies.exits`. Nothing heavy is imported before a study starts, so that
`hardspheres --help` answers at once.
"""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from hardspheres.errors import SceneError
from studies.commands import (
    CheckpointEvery,
    Force,
    Json,
    Out,
    Resume,
    Studies,
    UntilError,
)
from studies.exits import run_program
from studies.options import App, OptionError, at_most, boundary, one_number, positive

__all__ = ["app", "main"]

app = App(
    name="hardspheres",
    cls=Studies,
    help="Gases of hard spheres: ask a question, get numbers with error bars beside their theory.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


MOST = 1_000_000  # replicas, frames or runs: a typing error must not exhaust the memory


class Units(StrEnum):
    """Words for `--units`."""

    reduced = "reduced"
    ase = "ase"


class VelocitiesAre(StrEnum):
    """The word for `--velocities-are`."""

    reduced = "reduced"


class Velocities(StrEnum):
    """Words for `--velocities`."""

    maxwell = "maxwell"
    equal_speeds = "equal-speeds"
    two_temperatures = "two-temperatures"
    beams = "beams"


def _version(wanted: bool) -> None:
    if wanted:
        from hardspheres import __version__

        typer.echo(f"hardspheres {__version__}")
        raise typer.Exit


@app.callback()
def _everywhere(
    version: Annotated[
        bool,
        typer.Option("--version", "-V", callback=_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    pass


Seed = Annotated[
    int, typer.Option(min=0, help="Source of every random choice: the same seed gives the same results.")
]
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Processes; the results do not depend on it.", show_default="all cores"),
]
OfLabels = Annotated[
    str | None,
    typer.Option(
        help="Of all particles of --from, or of each label, as in A=0.5,B=0.3.",
        show_default="that of the file",
        metavar="NUMBER|LABEL=NUMBER,...",
    ),
]
OVER = "of a second species over the first's"
MASS = positive("--mass-ratio", f"the mass {OVER}")
DIAMETER = positive("--diameter-ratio", f"the diameter {OVER}")
MassRatio = Annotated[float, typer.Option(**MASS, help=f"Mass {OVER}; 1: the same.")]
DiameterRatio = Annotated[float, typer.Option(**DIAMETER, help=f"Diameter {OVER}; 1: the same.")]


@app.command()
def thermalise(
    n: Annotated[
        int | None, typer.Option(min=1, help="Particles in each replica.", show_default="4000")
    ] = None,
    dim: Annotated[
        int | None,
        typer.Option(
            min=2,
            max=3,
            help="Dimension; 2 with --from: it is of discs, whose z differ by at most 1e-6 diameters.",
            show_default="3",
        ),
    ] = None,
    packing_fraction: Annotated[float | None, typer.Option(**one_number, show_default="0.005")] = None,
    boundary: Annotated[str | None, typer.Option(**boundary, show_default="periodic")] = None,
    velocities: Annotated[
        Velocities | None,
        typer.Option(
            help="Initial velocities. maxwell: in equilibrium. equal-speeds: one speed, in all "
            "directions. two-temperatures: half of the particles hotter, or the first species. "
            "beams: half of them along one direction, half against it.",
            show_default="equal-speeds",
            metavar="WORD",
        ),
    ] = None,
    temperature: Annotated[float | None, typer.Option(help="kT of the gas.", show_default="1")] = None,
    temperature_ratio: Annotated[
        float | None,
        typer.Option(
            **positive("--temperature-ratio", "kT of the hot particles over that of the cold ones"),
            help="With --velocities two-temperatures: kT of the hot over that of the cold.",
            show_default="3",
        ),
    ] = None,
    mass_ratio: Annotated[
        float | None, typer.Option(**MASS, help=f"Mass {OVER}.", show_default="one species")
    ] = None,
    diameter_ratio: Annotated[
        float | None, typer.Option(**DIAMETER, help=f"Diameter {OVER}.", show_default="one species")
    ] = None,
    fraction: Annotated[
        float | None,
        typer.Option(min=0, max=1, help="Number fraction of the second species.", show_default="0.5"),
    ] = None,
    collisions_per_particle: Annotated[
        float, typer.Option(help="How long to run, s = 2 collisions / n.")
    ] = 10.0,
    replicas: Annotated[
        int, typer.Option(min=1, callback=at_most(MOST), help="Independent gases to average over.")
    ] = 100,
    until_error: UntilError = None,
    seed: Seed = 1,
    workers: Workers = None,
    source: Annotated[
        Path | None, typer.Option("--from", help="Start from a structure in any file that ASE reads.")
    ] = None,
    radius: OfLabels = None,
    mass: OfLabels = None,
    units: Annotated[
        Units | None,
        typer.Option(
            help="Units of --from, where ASE converts them: numbers as in the file (reduced), or "
            "Angstrom, u and eV (ase).",
            show_default="refused where it matters",
        ),
    ] = None,
    velocities_are: Annotated[
        VelocitiesAre | None,
        typer.Option(
            help="A column of velocities in --from is in units of its lengths.",
            show_default="refused where there is one",
        ),
    ] = None,
    box: Annotated[
        str | None,
        typer.Option(
            help="Edges of the box for a file of --from without one, as in 10,10,10.", metavar="LX,LY[,LZ]"
        ),
    ] = None,
    frames: Annotated[
        int,
        typer.Option(min=0, callback=at_most(MOST), help="Frames in trajectory.xyz, of the first replica."),
    ] = 21,
    animate: Annotated[
        bool, typer.Option("--animate", help="Write gas.gif, the first replica in motion.")
    ] = False,
    out: Out = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow the relaxation of a gas to the Maxwell-Boltzmann distribution.

    Measures the fourth cumulant a2, the Kolmogorov-Smirnov distance and Boltzmann's H against collisions per
    particle, averaged over replicas, beside the Boltzmann equation. Writes a summary, a table, pictures and a
    trajectory.
    """
    from studies.fluid import LONGEST
    from studies.report import Screen
    from studies.thermalisation import Recipe, Thermalisation, thermalise

    for_files = {"radius": radius, "mass": mass, "units": units, "velocities-are": velocities_are, "box": box}
    made = {"n": n, "dim": dim, "packing_fraction": packing_fraction, "boundary": _boundary(boundary)}
    made |= {"mass_ratio": mass_ratio, "diameter_ratio": diameter_ratio, "fraction": fraction}
    given = {key: value for key, value in made.items() if value is not None}
    _require(
        0.0 < collisions_per_particle <= LONGEST,
        f"--collisions-per-particle {collisions_per_particle:g} must be positive, and at most {LONGEST:g}",
    )
    common: dict[str, Any] = {
        "collisions_per_particle": collisions_per_particle,
        "replicas": replicas,
        "seed": seed,
    }
    common |= {"workers": workers, "frames": frames, "animate": animate}
    start = velocities.value if velocities else None
    _require(
        temperature_ratio is None or start == "two-temperatures",
        "--temperature-ratio goes with --velocities two-temperatures",
    )
    if source is not None:
        from hardspheres.files import Reading

        kept = ("dim",) if box is None else ("dim", "boundary")
        for name in (name for name in given if name not in kept):
            raise SceneError(
                f"--{name.replace('_', '-')} has no effect with --from, which gives the whole structure"
            )
        reading = Reading(
            _of_labels(radius, "--radius"),
            _of_labels(mass, "--mass"),
            next((word.value for word in (units, velocities_are) if word is not None), None),
            None if box is None else [_number(edge, "--box") for edge in box.split(",")],
            _boundary(boundary),
            dim,
        )
        study = Thermalisation.from_file(str(source), reading, start, temperature, **common)
        if temperature_ratio is not None:
            study = replace(study, recipe=replace(study.recipe, temperature_ratio=temperature_ratio))
    else:
        for name, value in for_files.items():
            _require(
                value is None, f"--{name} goes with --from; the spheres made here have diameter 1 and mass 1"
            )
        two = "mass_ratio" in given or "diameter_ratio" in given
        _require(two or fraction is None, "--fraction needs --mass-ratio or --diameter-ratio")
        given |= {} if start is None else {"velocities": start}
        given |= {} if temperature is None else {"temperature": temperature}
        given |= {} if temperature_ratio is None else {"temperature_ratio": temperature_ratio}
        study = Thermalisation(recipe=Recipe(**given), **common)  # type: ignore[arg-type]
    screen = Screen(json)
    folder = _folder(out, "thermalise", seed, checkpoint_every, resume, force)
    _finish(screen, _precisely(thermalise, study, folder, screen, until_error))


Densities = Annotated[
    str,
    typer.Option(
        "--packing-fraction",
        help="Volume fractions of the spheres: one, several with commas, or first:last:count.",
        metavar="NUMBER|LIST",
    ),
]
Fraction = Annotated[
    float | None,
    typer.Option(min=0, max=1, help="Number fraction of the second species.", show_default="0.5"),
]


@app.command()
def pressure(
    packing_fractions: Densities = "0.01:0.49:9",
    n: Annotated[int, typer.Option(min=2, help="Particles in each replica.")] = 4000,
    dim: Annotated[int, typer.Option(min=2, max=3, help="Dimension.")] = 3,
    boundary: Annotated[str, typer.Option(**boundary)] = "periodic",
    diameter_ratio: DiameterRatio = 1.0,
    mass_ratio: MassRatio = 1.0,
    fraction: Fraction = None,
    collisions_per_particle: Annotated[
        float | None,
        typer.Option(
            help="How long to measure in each replica, s = 2 collisions / n.",
            show_default="300, more near freezing",
        ),
    ] = None,
    suite: Annotated[
        bool,
        typer.Option(
            "--suite",
            help="Nine states of spheres, five of discs and three mixtures of 4000 particles; "
            "--until-error is 1e-3 (two minutes) or as given (1e-4: hours).",
        ),
    ] = False,
    replicas: Annotated[
        int, typer.Option(min=1, callback=at_most(MOST), help="Independent gases at each packing fraction.")
    ] = 2,
    until_error: UntilError = None,
    seed: Seed = 1,
    workers: Workers = None,
    out: Out = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Measure the equation of state of the fluid, beside theory.

    Pressure from the virial, from the collision rate (one species) and from the walls (where there are some),
    with error bars, at several packing fractions. Writes a summary, a table and a picture with residuals.
    """
    from studies.fluid import Fluid
    from studies.pressure import EquationOfState, equation_of_state
    from studies.pressure import packing_fractions as parsed
    from studies.report import Screen

    _require_two(diameter_ratio, mass_ratio, fraction)
    walls = _boundary(boundary) or "periodic"
    fluid = Fluid(n, dim, 0.3, walls, diameter_ratio, mass_ratio, 0.5 if fraction is None else fraction)
    study = EquationOfState(
        parsed(packing_fractions), fluid, collisions_per_particle, replicas, seed, workers
    )
    screen, folder = Screen(json), _folder(out, "pressure", seed, checkpoint_every, resume, force)
    if not suite:
        _finish(screen, _precisely(equation_of_state, study, folder, screen, until_error))
        return
    from studies.pressure_suite import Suite, run_suite

    gas = (packing_fractions, n, dim, walls, diameter_ratio, mass_ratio, fraction)
    _require(
        gas == ("0.01:0.49:9", 4000, 3, "periodic", 1.0, 1.0, None),
        "--suite has gases of its own; leave out the options that describe one",
    )
    if until_error is not None or collisions_per_particle is None:
        study = replace(study, precision=1e-3 if until_error is None else until_error)
    _finish(screen, run_suite(Suite(study), folder, screen))


def _precisely(
    run: Any, study: Any, folder: Any, screen: Any, target: float | None
) -> tuple[dict[str, Any], bool]:
    """Run a study as it is, or until its main number has the precision asked for."""
    if target is None:
        return run(study, folder, screen)  # type: ignore[no-any-return]
    from studies.until_error import until_error

    return until_error(study, target, folder, screen, run=run)


def _folder(
    out: Path | None, study: str, which: int | str, checkpoint_every: float, resume: bool, force: bool
) -> Any:
    """Return the output folder of a study."""
    from studies.report import OutputFolder

    if resume and force:
        raise OptionError("--resume continues a run and --force replaces it; give one of them")
    path = out or Path("runs") / f"{study}-{which}"
    return OutputFolder(path, checkpoint_every=checkpoint_every, resume=resume, force=force)


def _finish(screen: Any, result: tuple[dict[str, Any], bool]) -> None:
    """Print the JSON that was asked for, and exit with 1 if a check failed."""
    summary, sound = result
    screen.finish(summary)
    if not sound:
        raise typer.Exit(1)


def _require_two(diameter_ratio: float, mass_ratio: float, fraction: float | None) -> None:
    two = (diameter_ratio, mass_ratio) != (1.0, 1.0)
    _require(two or fraction is None, "--fraction needs --mass-ratio or --diameter-ratio")


def _boundary(words: str | None) -> str | tuple[str, ...] | None:
    """Return the boundary as Scene takes it: one word, or one per axis."""
    if words is None or "," not in words:
        return words
    return tuple(word.strip() for word in words.split(","))


def _of_labels(words: str | None, option: str) -> float | dict[str, float] | None:
    """Return the number for all particles, or that of each label."""
    if words is None:
        return None
    if "=" not in words:
        return _number(words, option)
    pairs = [word.rpartition("=") for word in words.split(",")]
    _require(all(label and value for label, _, value in pairs), f"{option} {words} is not as in A=0.5,B=0.3")
    return {label.strip(): _number(value, option) for label, _, value in pairs}


def _number(word: str, option: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise OptionError(f"{option}: {word!r} is no number") from None


def _require(condition: bool, sentence: str) -> None:
    if not condition:
        raise SceneError(sentence)


def main() -> None:
    """Run the command line and exit with its code."""
    run_program(app)


if __name__ == "__main__":
    main()
