"""The console script `hardspheres`: parses options, runs a study, returns an exit code.

Exit codes are those of `studies.exits`. Nothing heavy is imported before a study starts, so that
`hardspheres --help` answers at once.
"""

from __future__ import annotations

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
from studies.options import App, OptionError, at_most, one_number, positive

__all__ = ["app", "main"]

app = App(
    name="hardspheres",
    cls=Studies,
    help="Gases of hard spheres: ask a question, get numbers with error bars beside their theory.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


MOST = 1_000_000  # replicas, frames or runs: a typing error must not exhaust the memory


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
OVER = "of a second species over the first's"
MASS = positive("--mass-ratio", f"the mass {OVER}")
DIAMETER = positive("--diameter-ratio", f"the diameter {OVER}")
MassRatio = Annotated[float, typer.Option(**MASS, help=f"Mass {OVER}; 1: the same.")]
DiameterRatio = Annotated[float, typer.Option(**DIAMETER, help=f"Diameter {OVER}; 1: the same.")]


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
def free_path(
    packing_fractions: Densities = "0.001,0.01,0.1,0.3",
    n: Annotated[int, typer.Option(min=2, help="Particles in each replica.")] = 4000,
    dim: Annotated[int, typer.Option(min=2, max=3, help="Dimension.")] = 3,
    diameter_ratio: DiameterRatio = 1.0,
    mass_ratio: MassRatio = 1.0,
    fraction: Fraction = None,
    collisions_per_particle: Annotated[
        float, typer.Option(help="How long to measure in each replica, s = 2 collisions / n.")
    ] = 300.0,
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
    """Measure free paths between collisions, beside kinetic theory.

    Mean free path and time, collision rates between species, moments and survival functions of all flights,
    and the free path at each speed, with error bars, at several packing fractions. Writes a summary, two
    tables and a picture.
    """
    from studies.fluid import Fluid
    from studies.free_path import FreePaths
    from studies.free_path import free_path as run
    from studies.options import packing_fractions as parsed
    from studies.report import Screen

    _require_two(diameter_ratio, mass_ratio, fraction)
    share = 0.5 if fraction is None else fraction
    fluid = Fluid(n, dim, 0.3, "periodic", diameter_ratio, mass_ratio, share)
    study = FreePaths(parsed(packing_fractions), fluid, collisions_per_particle, replicas, seed, workers)
    screen = Screen(json)
    folder = _folder(out, "free-path", seed, checkpoint_every, resume, force)
    _finish(screen, _precisely(run, study, folder, screen, until_error))


@app.command()
def mixture(
    packing_fraction: Annotated[float, typer.Option(**one_number)] = 0.01,
    n: Annotated[int, typer.Option(min=2, help="Particles in each replica.")] = 2000,
    dim: Annotated[int, typer.Option(min=2, max=3, help="Dimension.")] = 3,
    diameter_ratio: DiameterRatio = 2.0,
    mass_ratio: MassRatio = 10.0,
    fraction: Fraction = None,
    temperature_ratio: Annotated[
        float,
        typer.Option(
            **positive("--temperature-ratio", "kT of the first species over the second's at the start"),
            help="kT of the first species over the second's at the start.",
        ),
    ] = 3.0,
    relaxation_times: Annotated[
        float, typer.Option(help="How long to run, in initial decay times of the difference.")
    ] = 4.0,
    replicas: Annotated[
        int, typer.Option(min=1, callback=at_most(MOST), help="Independent gases to average over.")
    ] = 100,
    until_error: UntilError = None,
    seed: Seed = 1,
    workers: Workers = None,
    out: Out = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow the temperature equilibration of two species, beside kinetic theory.

    Temperatures of both against time, averaged over replicas, beside the two-Maxwellian equations with their
    known deviation, and the collision rate. Writes a summary, a table and a picture.
    """
    from studies.fluid import Fluid
    from studies.mixture import Mixture
    from studies.mixture import mixture as run
    from studies.report import Screen

    share = 0.5 if fraction is None else fraction
    fluid = Fluid(n, dim, packing_fraction, "periodic", diameter_ratio, mass_ratio, share)
    study = Mixture(fluid, temperature_ratio, relaxation_times, replicas, seed, workers)
    screen = Screen(json)
    folder = _folder(out, "mixture", seed, checkpoint_every, resume, force)
    _finish(screen, _precisely(run, study, folder, screen, until_error))


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


def _require(condition: bool, sentence: str) -> None:
    if not condition:
        raise SceneError(sentence)


def main() -> None:
    """Run the command line and exit with its code."""
    run_program(app)


if __name__ == "__main__":
    main()
