"""Commands of the command line, made from the fields of studies."""

from __future__ import annotations

import contextlib
import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from hardspheres.errors import SceneError
from studies.exits import run_program
from studies.formats import FORMATS
from studies.options import App, OptionError, options_of, rewrapped, word
from studies.registry import QUESTIONS, study_named

if TYPE_CHECKING:
    from studies.config import Config
    from studies.program import Program

__all__ = ["Studies", "command_of", "main"]


def _out(name: str) -> Path:
    """Return the folder that --out names; an empty name is an error, not the current folder."""
    if not name.strip():
        raise OptionError("--out is empty; name a folder for the results")
    return Path(name)


Out = Annotated[
    Path | None,
    typer.Option(
        help="Folder for the results.", show_default="runs/<study>-<seed>", parser=_out, metavar="PATH"
    ),
]
CheckpointEvery = Annotated[
    float,
    typer.Option(min=0, help="Seconds of wall time between two checkpoints of a run.", metavar="SECONDS"),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume", help="Go on with the unfinished run in the folder, begun with the same options."
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Replace the run in the folder, once there are results to put in its place."
    ),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print summary.json on standard output, the rest on standard error.")
]


def _shard(text: str) -> Any:
    """Return the shard that a text names."""
    from studies.running.shards import Shard

    return Shard.parsed(text)


OfAShard = Annotated[
    Any,
    typer.Option(
        "--shard",
        help="Run the k-th of n parts of the study into the folder, beside the other parts, and write no "
        "results: --resume gathers them.",
        show_default="all of it",
        parser=_shard,
        metavar="k/n",
    ),
]
UntilError = Annotated[
    float | None,
    typer.Option(
        help="Relative standard error wanted of the main number, such as 1e-3: a pilot of --replicas "
        "(at most 20) decides how many replicas are run, at most 1000 times the pilot.",
        show_default="as many as --replicas",
    ),
]
Keep = Annotated[
    bool | None,
    typer.Option(
        "--keep/--no-keep",
        help="Whether the replicas stay beside the results: then more --replicas extend the run, and "
        "combine joins it with runs of other seeds.",
        show_default="if they take at most 50 MB",
    ),
]
Sweep = Annotated[
    str | None,
    typer.Option(
        help="Run it at several values of an option, as in n=500,1000,2000 or n=500:2000:4: a "
        "whole run of each, in a folder of its own, and a figure over the values.",
        metavar="NAME=LIST",
        show_default=False,
    ),
]
Format = Annotated[str, typer.Option("--format", help="Format of figures.", **word("--format", *FORMATS))]
OF_EVERY_RUN: dict[str, tuple[Any, Any]] = {
    "out": (Out, None),
    "force": (Force, False),
    "json": (Json, False),
}
OF_FIGURES: dict[str, tuple[Any, Any]] = {"figure_format": (Format, "png")}
OF_LONG_RUNS: dict[str, tuple[Any, Any]] = {
    "checkpoint_every": (CheckpointEvery, 60.0),
    "resume": (Resume, False),
}
OF_REPLICAS: dict[str, tuple[Any, Any]] = {"keep": (Keep, None)}


def _of_a_page(name: str) -> dict[str, tuple[Any, Any]]:
    """Return --out, --force and --json of what writes a single page, which is called this by default."""
    out = typer.Option(help="Name of the page.", show_default=name, parser=_out, metavar="PATH")
    force = typer.Option("--force", help="Replace the page.")
    json = typer.Option(
        "--json", help="Print on standard output, as JSON, what the page has; the rest on standard error."
    )
    kinds = {"out": (Annotated[Path | None, out], None), "force": (Annotated[bool, force], False)}
    return kinds | {"json": (Annotated[bool, json], False)}


def _if_asked() -> dict[str, tuple[Any, Any]]:
    """Return --out and --force of what writes nothing by itself."""
    out = typer.Option(
        help="Folder for summary.json.", show_default="nothing is written", parser=_out, metavar="PATH"
    )
    force = typer.Option("--force", help="Replace the summary in the folder.")
    return {"out": (Annotated[Path | None, out], None), "force": (Annotated[bool, force], False)}


def _config(kind: type[Program], declared: dict[str, tuple[Any, Any]]) -> tuple[Any, Any]:
    """Return --config of a command with these parameters: it is read before all others get their values."""

    def read(ctx: typer.Context, file: str | None) -> Any:
        from studies.config import configure

        return None if file is None or ctx.resilient_parsing else configure(kind, declared, ctx, file)

    told = (
        "Take options from a file: the summary.json of an earlier run, or TOML with the names of options; "
        "those given here win."
    )
    its = typer.Option(help=told, is_eager=True, callback=read, metavar="FILE", show_default=False)
    return Annotated[str | None, its], None


@contextlib.contextmanager
def _beside(config: Config | None) -> Iterator[None]:
    """Name the file of --config beside what is wrong with options."""
    try:
        yield
    except (OptionError, SceneError) as error:
        if config is not None:
            error.add_note(f"options that are not given here are those of {config.file}")
        raise


def function_of(kind: type[Program]) -> Callable[..., None]:
    """Return the function that the command of a study runs: its parameters are the study's options."""

    def run(
        out: Path | None,
        force: bool,
        json: bool,
        figure_format: str = "png",
        until_error: float | None = None,
        checkpoint_every: float = 60.0,
        resume: bool = False,
        keep: bool | None = None,
        config: Config | None = None,
        sweep: str | None = None,
        ctx: Any = None,
        shard: Any = None,
        **given: Any,
    ) -> None:
        from studies.report import Screen

        screen = Screen(json)
        if shard is not None:
            shard.require_alone(
                resume=resume,
                force=force,
                json=json,
                until_error=until_error is not None,
                keep=keep is not None,
                sweep=sweep is not None,
                executor=given.get("executor") not in (None, "processes"),
            )
        for remark in config.remarks if config is not None else ():
            screen.note(remark)
        values = {name: tuple(v) if isinstance(v, list) else v for name, v in given.items() if v is not None}
        with _beside(config):
            program: Any = kind(**values)
            if sweep is not None:
                from studies.sweep import asked, conduct_sweep

                option, swept = asked(program, parameters, ctx, sweep)
                out = out or Path("runs") / f"{program.name}-over-{option}-{program.which}"
            folder = program.folder(out, checkpoint_every, resume, force)
            folder.figure_format, folder.keep, folder.shard = figure_format, keep, shard
            if sweep is not None:
                summary, sound = conduct_sweep(program, option, swept, folder, screen, until_error)
            elif until_error is None:
                summary, sound = program.prepared(screen.note).conduct(folder, screen)
            else:
                from studies.until_error import until_error as precisely

                summary, sound = precisely(program.prepared(screen.note), until_error, folder, screen)
        screen.finish(summary)
        if not sound:
            raise typer.Exit(1)

    hints = get_type_hints(kind)
    parameters: dict[str, tuple[Any, Any]] = {}
    for each, its in options_of(kind):
        if its.argument:
            stands = typer.Argument(help=its.help, show_default=False, **its.more)
            standing = list[str] if its.several else hints[each.name]
            parameters[each.name] = (Annotated[standing, stands], inspect.Parameter.empty)
            continue
        default = each.default if isinstance(each.default, (bool, int, float, str)) else None
        declared = typer.Option(
            its.named(each.name), help=its.help, show_default=its.shown or True, **its.more
        )
        annotation = hints[each.name]
        if "parser" in its.more:  # it makes the value of a text, whatever that is
            annotation = str | None if default is None else type(default)
        if its.several:
            each_of: Any = str if "parser" in its.more else get_args(hints[each.name])[0]
            annotation = list[each_of] | None
        parameters[each.name] = (Annotated[annotation, declared], default)
    parameters |= OF_EVERY_RUN
    if kind.page:
        parameters |= _of_a_page(kind.page)
    if kind.only_if_asked:
        parameters |= _if_asked()
    if any(name.endswith(".png") for name in kind.files):
        parameters |= OF_FIGURES
    if kind.resumable:
        parameters |= OF_LONG_RUNS
    if kind.keeps:
        parameters |= OF_REPLICAS
    if kind.in_shards:
        parameters["shard"] = (OfAShard, None)
    if kind.to_an_error:
        parameters["until_error"] = (UntilError, None)
    parameters["config"] = _config(kind, parameters)
    if kind.sweeps:
        parameters["sweep"] = (Sweep, None)
        parameters["ctx"] = (typer.Context, None)
    keyword = inspect.Parameter.KEYWORD_ONLY
    run.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [
            inspect.Parameter(name, keyword, default=default, annotation=annotation)
            for name, (annotation, default) in parameters.items()
        ]
    )
    run.__annotations__ = {name: annotation for name, (annotation, _) in parameters.items()}
    return run


def command_of(kind: type[Program], question: str = "") -> Any:
    """Return the command of a study.

    Parameters
    ----------
    kind : type
        The study's class.
    question : str, optional
        First line of its help, before its explanation.
    """
    alone = App(pretty_exceptions_enable=False, add_completion=False)
    text = rewrapped(f"{question}\n\n{inspect.cleandoc(kind.explanation)}")
    alone.command(kind.name, help=text)(function_of(kind))
    return typer.main.get_command(alone)


class Studies(TyperGroup):
    """The group of all commands; a study is imported when it is called, not when commands are listed."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return studies, then the other commands."""
        return [*QUESTIONS, *super().list_commands(ctx)]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; that of a study knows only its question."""
        if cmd_name in QUESTIONS:
            return TyperCommand(cmd_name, help=QUESTIONS[cmd_name][1])
        return super().get_command(ctx, cmd_name)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and remaining arguments; a study is imported here."""
        if args and args[0] in QUESTIONS:
            return args[0], command_of(study_named(args[0]), QUESTIONS[args[0]][1]), args[1:]
        return super().resolve_command(ctx, args)


def main(kind: type[Program]) -> None:
    """Run a study of one's own as a program: `if __name__ == "__main__": main(MyStudy)`."""
    run_program(command_of(kind))
