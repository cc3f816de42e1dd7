"""The console script `hardspheres`: parses options, runs a study, returns an exit code.

Exit codes: 0 done, 1 a check failed, 2 bad input or output that cannot be written, 129 hung up, 130
interrupted, 143 terminated. Nothing heavy is imported before a study starts, so that `hardspheres --help`
answers at once.
"""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from hardspheres.errors import HardSpheresError, SceneError
from studies.commands import (
    CheckpointEvery,
    Force,
    Json,
    Out,
    Resume,
    Studies,
    UntilError,
    _out,
)
from studies.layout import wrapped
from studies.options import App, OptionError, at_most, boundary, one_number, positive, word

__all__ = ["app", "main"]

app = App(
    name="hardspheres",
    cls=Studies,
    help="Gases of hard spheres: ask a question, get numbers with error bars beside their theory.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


ENDED = {129: "hung up, as a terminal does when it is closed", 130: "interrupted", 143: "terminated"}
GROUPS = (
    "galperin",
    "cradle",
    "ratios",
    "grazing",
    "packing",
    "distances",
    "reversal",
    "symmetries",
    "exactly-solved",
)
"""Of hard cases, as in `studies.validation.hard_cases`, which is too heavy to be imported for this."""
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


@app.command()
def bench(
    n: Annotated[
        list[int] | None,
        typer.Option(help="Particles; with --suite may be given several times.", show_default="4000"),
    ] = None,
    dim: Annotated[int, typer.Option(min=2, max=3, help="Dimension.")] = 3,
    packing_fraction: Annotated[
        list[str] | None,
        typer.Option(
            help="Volume fraction of the spheres; with --suite several: first:last:count, or numbers "
            "with commas.",
            show_default="0.3",
            metavar="NUMBER|LIST",
        ),
    ] = None,
    boundary: Annotated[str, typer.Option(**boundary)] = "periodic",
    diameter_ratio: DiameterRatio = 1.0,
    mass_ratio: MassRatio = 1.0,
    fraction: Annotated[
        float, typer.Option(min=0, max=1, help="Number fraction of the second species.")
    ] = 0.5,
    start: Annotated[
        str,
        typer.Option(
            **word("--start", "auto", "lattice", "fluid"),
            help="lattice: a crystal with random velocities. fluid: at random, grown where it is dense. "
            "auto: a fluid where that is the equilibrium state.",
        ),
    ] = "auto",
    collisions: Annotated[
        int | None, typer.Option(help="Collisions to time, in 20 windows.", show_default="4 s worth")
    ] = None,
    discard: Annotated[
        float | None,
        typer.Option(
            help="Collisions per particle to discard before timing.",
            show_default="10, more where it must melt or relax",
        ),
    ] = None,
    against: Annotated[
        str | None,
        typer.Option(
            **word("--against", "spheropack", "plain"),
            help="spheropack: run it in turn with ours and compare; plain: our own engine on as many equal "
            "spheres, periodic, in 3D.",
        ),
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            **word("--suite", "quick", "full"),
            help="quick (3 min) or full (10 to 20 min): a table over N and packing fraction, with a figure.",
        ),
    ] = None,
    seed: Seed = 1,
    out: Out = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Measure collisions per second, beside another engine.

    Times the event loop alone, compiled and in equilibrium, on one core. Writes a summary and the windows;
    with --suite a table and a figure. Keeps no checkpoints, since an interruption would invalidate the
    timing.
    """
    from studies.benchmarks.bench import Bench
    from studies.benchmarks.bench import bench as run
    from studies.benchmarks.gas import Gas
    from studies.benchmarks.suite import run_suite, suite_named
    from studies.pressure import packing_fractions as parsed
    from studies.report import OutputFolder, Screen

    folder = OutputFolder(out or _next_folder(Path("runs") / f"bench-{seed}", force), force=force)
    screen = Screen(json)
    sizes = n or [4000]
    densities = [eta for text in packing_fraction or ["0.3"] for eta in parsed(text)]
    walls = _boundary(boundary) or "periodic"
    study = Bench(
        Gas(sizes[0], dim, densities[0], walls, diameter_ratio, fraction, start, mass_ratio),
        collisions,
        discard,
    )
    study = replace(study, against=against, seed=seed)
    if suite is not None:
        summary, sound = run_suite(
            suite_named(suite, n, densities if packing_fraction else None), study, folder, screen
        )
    else:
        for name, given in (("--n", sizes), ("--packing-fraction", densities)):
            _require(
                len(given) == 1, f"{name} is given {len(given)} times, but one state has one; add --suite"
            )
        summary, sound = run(study, folder, screen)
    screen.finish(summary)
    if not sound:
        raise typer.Exit(1)


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
    from studies.pressure import packing_fractions as parsed
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


@app.command()
def accuracy(
    packing_fractions: Densities = "0.01,0.3",
    n: Annotated[int, typer.Option(min=2, help="Particles of the long runs.")] = 4000,
    dim: Annotated[int, typer.Option(min=2, max=3, help="Dimension.")] = 3,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer and shorter runs: half a minute.")] = False,
    seed: Seed = 1,
    out: Out = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Compare speed and error with two time-stepping programs.

    The engine, the all-pairs solver and bouncing balls by time steps on the same gases in one run: distance
    from the trajectory at 50 digits, missed collisions, overlaps, pressure and mean free path, and cost.
    Writes a summary, a table and a picture. Every finished scene and state is kept; an interrupted one starts
    again.
    """
    from studies.pressure import packing_fractions as parsed
    from studies.report import Screen
    from studies.validation.accuracy import Accuracy
    from studies.validation.accuracy import accuracy as run

    study = Accuracy(parsed(packing_fractions), n, dim, seed)
    screen, folder = Screen(json), _folder(out, "accuracy", seed, checkpoint_every, resume, force)
    _finish(screen, run(study.quicker() if quick else study, folder, screen))


def _precisely(
    run: Any, study: Any, folder: Any, screen: Any, target: float | None
) -> tuple[dict[str, Any], bool]:
    """Run a study as it is, or until its main number has the precision asked for."""
    if target is None:
        return run(study, folder, screen)  # type: ignore[no-any-return]
    from studies.until_error import until_error

    return until_error(run, study, target, folder, screen)


@app.command()
def calibration(
    runs: Annotated[
        int, typer.Option(callback=at_most(MOST), help="Independent short runs of each estimator.")
    ] = 200,
    seed: Seed = 1,
    workers: Workers = None,
    out: Out = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Test the error bars: (value - truth) / standard error of every estimator, over many short runs.

    It should follow Student's t with the degrees of freedom that the estimator quotes. Writes a summary, a
    table and a picture.
    """
    from studies.report import Screen
    from studies.validation.calibration import Calibrations
    from studies.validation.calibration import calibration as run

    screen, folder = Screen(json), _folder(out, "calibration", seed, checkpoint_every, resume, force)
    _finish(screen, run(Calibrations(runs, seed, workers), folder, screen))


@app.command("hard-cases")
def hard_cases(
    size: Annotated[
        str,
        typer.Option(
            **word("--size", "small", "full", "long"),
            help="small (a minute), full (some minutes) or long (hours).",
        ),
    ] = "full",
    only: Annotated[
        list[str] | None,
        typer.Option(
            **word("--only", *GROUPS),
            help=f"One group of cases: {', '.join(GROUPS)}; may be given several times.",
            show_default="all nine",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the results.",
            show_default="runs/hard-cases-<size>",
            parser=_out,
            metavar="PATH",
        ),
    ] = None,
    checkpoint_every: CheckpointEvery = 60.0,
    resume: Resume = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Test the engine on hard cases with exact answers.

    Collisions that count digits of pi, cradles, wide ratios of mass and size, grazing collisions, close
    packing, huge and tiny boxes, reversal, symmetries, solved gases. Writes a table of the exact answer, the
    engine's, and the number of correct digits. Every finished long run is kept; an interrupted one starts
    again.
    """
    from studies.report import Screen
    from studies.validation.hard_cases import groups_named, size_named
    from studies.validation.hard_cases import hard_cases as run

    chosen, groups, screen = size_named(size), groups_named(only), Screen(json)
    folder = _folder(out, "hard-cases", chosen, checkpoint_every, resume, force)
    _finish(screen, run(chosen, groups, folder, screen))


def _folder(
    out: Path | None, study: str, which: int | str, checkpoint_every: float, resume: bool, force: bool
) -> Any:
    """Return the output folder of a study."""
    from studies.report import OutputFolder

    if resume and force:
        raise OptionError("--resume continues a run and --force replaces it; give one of them")
    path = out or Path("runs") / f"{study}-{which}"
    return OutputFolder(path, checkpoint_every=checkpoint_every, resume=resume, force=force)


def _next_folder(path: Path, force: bool) -> Path:
    """Return the first of path, path-2, path-3, ... without results; a timing is repeated, not resumed."""
    from studies.running.ownership import SUMMARY, WRITTEN

    names, taken = {SUMMARY, *WRITTEN["bench"], *WRITTEN["suite"]}, path
    for number in itertools.count(2):
        if force or not any(os.path.lexists(taken / name) for name in names):
            break
        taken = path.with_name(f"{path.name}-{number}")
    return taken


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


def _ended(number: int, _: object) -> NoReturn:
    for stream in (
        1,
        2,
    ):  # the terminal may be closed: writing to it on the way out would raise another error
        try:
            os.write(stream, b"")
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    raise SystemExit(128 + number)


def main() -> None:
    """Run the command line and exit with its code."""
    run_program(app)


def run_program(program: Any) -> None:
    """Run a command or a group of commands, and exit with its code."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, _ended)
    try:
        program()
    except HardSpheresError as error:
        _leave(2, f"error: {error}{_notes(error)}")
    except MemoryError as error:
        _leave(2, f"error: there is not enough memory ({error}); ask for fewer particles{_notes(error)}")
    except KeyboardInterrupt as error:
        _leave(130, f"{ENDED[130]}{_notes(error)}")
    except SystemExit as error:
        if error.code not in ENDED:
            raise
        _leave(int(error.code), f"{ENDED[error.code]}{_notes(error)}")


def _leave(code: int, sentence: str) -> NoReturn:
    """Print the reason, wrapped to the terminal if there still is one, and exit."""
    width = shutil.get_terminal_size().columns if sys.stderr.isatty() else None
    try:
        print("\n".join(wrapped(sentence, width)), file=sys.stderr, flush=True)
    except OSError:  # a terminal that was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    raise SystemExit(code) from None


def _notes(error: BaseException | None) -> str:
    """Return the notes added to an error and to the errors that caused it."""
    if error is None:
        return ""
    own = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
    return own or _notes(error.__cause__ or error.__context__)


if __name__ == "__main__":
    main()
