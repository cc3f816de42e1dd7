"""Parsing and help of command-line options: words from a list, valid numbers, panels in `--help`.

Parsers run before large imports, and refuse a value in one sentence.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable
from typing import Any

import typer
from typer.core import TyperCommand

from hardspheres.errors import HardSpheresError

__all__ = ["App", "OptionError", "at_most", "boundary", "one_number", "positive", "word"]


class OptionError(HardSpheresError):
    """An invalid option."""


def _either(words: tuple[str, ...]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}" if len(words) > 1 else words[0]


def word(option: str, *words: str) -> dict[str, Any]:
    """Return what `typer.Option` needs for an option that is one of some words.

    Parameters
    ----------
    option : str
        Its name, with dashes.
    *words : str
        The choices, in the order of the help.
    """

    def parsed(text: str) -> str:
        if text not in words:
            raise OptionError(f"{option} {text} is not known; it can be {_either(words)}")
        return text

    metavar = "|".join(words) if len(words) < 5 else "WORD"
    return {"parser": parsed, "metavar": metavar, "autocompletion": lambda: list(words)}


def _boundary(text: str) -> str:
    for part in text.split(","):
        if part.strip() not in ("periodic", "wall"):
            raise OptionError(
                f"--boundary {text} is not known; it can be periodic or wall, or one of them for each axis, "
                "as in periodic,periodic,wall"
            )
    return text


boundary: dict[str, Any] = {
    "parser": _boundary,
    "metavar": "WORD",
    "help": "periodic or wall (elastic), or one word for each axis, as in periodic,periodic,wall.",
    "autocompletion": lambda: ["periodic", "wall", "periodic,periodic,wall"],
}
"""What `typer.Option` needs for `--boundary`."""


def positive(option: str, what: str) -> dict[str, Any]:
    """Return what `typer.Option` needs for a positive number.

    Parameters
    ----------
    option : str
        Its name, with dashes.
    what : str
        What it is, for the error message.
    """

    def parsed(text: str | float) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not 0.0 < number < math.inf:
            raise OptionError(f"{option} {text} must be positive and finite: it is {what}")
        return number

    return {"parser": parsed, "metavar": "NUMBER"}


def _one_number(text: str | float) -> float:
    try:
        return float(text)
    except ValueError:
        several = "," in str(text) or ":" in str(text)
        why = "names several, but this study is of one gas; give one number" if several else "is not a number"
        raise OptionError(f"--packing-fraction {text} {why}") from None


one_number: dict[str, Any] = {
    "parser": _one_number,
    "metavar": "NUMBER",
    "help": "Volume fraction of the spheres.",
}
"""What `typer.Option` needs for `--packing-fraction` of a study of one gas."""


def at_most(limit: int) -> Callable[[typer.CallbackParam, int], int]:
    """Return a callback that refuses larger numbers; a range would take a third of the help."""

    def checked(param: typer.CallbackParam, value: int) -> int:
        if value > limit:
            raise OptionError(f"{param.opts[0]} {value} is too many; ask for at most {limit}")
        return value

    return checked


PANELS = {
    "The gas": "n dim packing_fraction packing_fractions boundary start velocities temperature "
    "temperature_ratio mass_ratio diameter_ratio fraction source radius mass box units velocities_are",
    "What and how long": "collisions collisions_per_particle relaxation_times discard replicas runs "
    "until_error suite quick size only against",
    "Results": "out force json frames animate",
    "The run itself": "seed workers checkpoint_every resume",
}
_PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
_KIND_OF = {"source": "FILE", "units": "WORD", "velocities_are": "WORD", "box": "NUMBERS"}  # others: NUMBER
_SAME = {"packing-fractions": "packing-fraction"}  # old spellings of options


def _rewrapped(text: str) -> str:
    """Join the lines of each paragraph, so that they can be wrapped to any width."""
    return "\n\n".join(re.sub(r"\s*\n\s*", " ", part) for part in inspect.cleandoc(text).split("\n\n"))


class _Command(TyperCommand):
    """A command whose options are shown briefly in panels."""

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        for option in self.params:
            name = str(option.name)
            if hasattr(option, "rich_help_panel"):
                option.rich_help_panel = option.rich_help_panel or _PANEL_OF.get(name)
            if option.metavar is None and not getattr(option, "is_flag", False):
                option.metavar = _KIND_OF.get(name, "NUMBER")


class App(typer.Typer):
    """A command line whose commands are `_Command`s, and take the old spellings of options."""

    def __init__(self, **named: Any) -> None:
        settings = {"help_option_names": ["-h", "--help"], "token_normalize_func": lambda s: _SAME.get(s, s)}
        super().__init__(context_settings=settings, **named)

    def command(self, name: str | None = None, **named: Any) -> Callable[[Any], Any]:  # type: ignore[override]
        """Register a function as a command; its docstring is the help."""

        def registered(function: Any) -> Any:
            named.setdefault("help", _rewrapped(function.__doc__ or ""))
            return super(App, self).command(name, cls=_Command, **named)(function)

        return registered
