"""The console script `hardspheres`: its commands are those of `studies.registry`.

Exit codes are those of `studies.exits`. Nothing heavy is imported before a command is called, so that
`hardspheres --help` answers at once.
"""

from __future__ import annotations

from typing import Annotated

import typer

from studies.commands import Studies
from studies.exits import run_program
from studies.options import App

__all__ = ["app", "main"]

app = App(
    name="hardspheres",
    cls=Studies,
    help="Gases of hard spheres: ask a question, get numbers with error bars beside their theory.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


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


@app.command("list")
def _list(
    folder: Annotated[
        str | None, typer.Argument(help="Where; runs by default.", show_default=False, metavar="FOLDER")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="Print the same as one JSON object on standard output.")
    ] = False,
) -> None:
    """Show which runs are in a folder, newest first.

    A table: folder, study, gas, replicas, date, and state: finished, unfinished with how many of its runs are
    done, or damaged and why. Folders that no study of hardspheres wrote are passed over.
    """
    from studies.listing import list_runs
    from studies.report import Screen

    list_runs(folder, Screen(json))


def main() -> None:
    """Run the command line and exit with its code."""
    run_program(app)


if __name__ == "__main__":
    main()
