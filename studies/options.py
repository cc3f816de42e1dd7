"""Options of studies: fields of a dataclass that are also options of the command line.

A field made by `option` has a default, a line of help and limits. Parsers run before large imports, and
refuse a value in one sentence.
"""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field, fields
from typing import Any

import typer
from typer.core import TyperCommand

from hardspheres.errors import HardSpheresError

__all__ = [
    "App",
    "Option",
    "OptionError",
    "boundary",
    "check_options",
    "edges",
    "in_words",
    "of_labels",
    "one_number",
    "option",
    "options_of",
    "packing_fractions",
    "positive",
    "rewrapped",
    "whole_numbers",
    "word",
]

MANY = 1_000_000  # replicas, frames or runs: a typing error must not exhaust the memory
MOST = 10_000  # packing fractions


class OptionError(HardSpheresError):
    """An invalid option."""


@dataclass(frozen=True)
class Option:
    """What the command line says of a field, and what it refuses.

    Attributes
    ----------
    help : str
        One line.
    at_least, at_most : float, optional
        Limits, inclusive.
    shown : str, optional
        The default in words, where it is not the value itself.
    flag : str, optional
        Its name on the command line; by default that of the field, with dashes.
    several : bool
        Whether it may be given several times; the field is then a tuple.
    argument : bool
        Whether it stands without a name on the command line, where it must be given.
    matters : bool
        Whether results depend on it: an option that does not is no part of what made them, so that it may
        change when a run is resumed, extended, combined or repeated.
    more : mapping
        Other arguments of `typer.Option`: parser, metavar, autocompletion.
    """

    help: str
    at_least: float | None = None
    at_most: float | None = None
    shown: str | None = None
    flag: str | None = None
    several: bool = False
    argument: bool = False
    matters: bool = True
    more: Mapping[str, Any] = field(default_factory=dict)

    def named(self, name: str) -> str:
        """Return the name on the command line of the field of this name."""
        return self.flag or f"--{name.replace('_', '-')}"

    def typed(self, name: str, value: Any) -> list[str]:
        """Return the words of the command line that give the field of this name this value."""
        flag = [] if self.argument else [self.named(name)]
        if isinstance(value, bool):
            return flag
        each_alone = value if self.several else [value]
        return [word for each in each_alone for word in (*flag, in_words(each))]

    def check(self, name: str, value: Any) -> None:
        """Raise OptionError where a value is beyond the limits."""
        if value is None or self.several:
            return
        low, high = self.at_least, self.at_most
        if (low is None or value >= low) and (high is None or value <= high):
            return
        asked = f"at least {low:.15g}" if low is not None else f"at most {high:.15g}"
        if low is not None and high is not None:
            asked = f"{low:.15g} to {high:.15g}"
        raise OptionError(f"{self.named(name)} {value} is out of range; ask for {asked}")


def option(
    default: Any,
    help: str = "",
    *,
    at_least: float | None = None,
    at_most: float | None = None,
    shown: str | None = None,
    flag: str | None = None,
    several: bool = False,
    argument: bool = False,
    matters: bool = True,
    **more: Any,
) -> Any:
    """Return a dataclass field that is also an option of the command line, see `Option`.

    Parameters
    ----------
    default
        Its value where it is not given.
    help, at_least, at_most, shown, flag, several, argument, matters
        As in `Option`.
    **more
        Other arguments of `typer.Option`; `help` may be among them.
    """
    told = help or more.pop("help")
    made = Option(told, at_least, at_most, shown, flag, several, argument, matters, more)
    return field(default=default, metadata={"option": made})


def in_words(value: Any) -> str:
    """Return a value as one word of the command line."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, Mapping):
        return ",".join(f"{key}={in_words(each)}" for key, each in value.items())
    if isinstance(value, float):
        return f"{value:g}" if float(f"{value:g}") == value else str(value)
    return ",".join(map(in_words, value)) if isinstance(value, (tuple, list)) else str(value)


def options_of(study: Any) -> list[tuple[Field[Any], Option]]:
    """Return the fields of a study, or of its class, that are options."""
    return [(each, each.metadata["option"]) for each in fields(study) if "option" in each.metadata]


def check_options(study: Any) -> None:
    """Raise OptionError where a field is beyond its limits."""
    for each, its in options_of(study):
        its.check(each.name, getattr(study, each.name))


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

    metavar = "|".join(words) if len(words) < 4 else "WORD"
    return {"parser": parsed, "metavar": metavar, "autocompletion": lambda: list(words)}


def boundary_of(text: str) -> str | tuple[str, ...]:
    """Return the boundary as Scene takes it: one word, or one for each axis."""
    words = tuple(part.strip() for part in text.split(","))
    if not {*words} <= {"periodic", "wall"}:
        raise OptionError(
            f"--boundary {text} is not known; it can be periodic or wall, or one of them for each axis, as "
            "in periodic,periodic,wall"
        )
    return words if "," in text else text


boundary: dict[str, Any] = {
    "parser": boundary_of,
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


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise OptionError(f"{option}: {text!r} is no number") from None


def of_labels(option: str, file: str = "--from") -> dict[str, Any]:
    """Return what `typer.Option` needs for a number of all particles of a file, or of each label.

    Parameters
    ----------
    option : str
        Its name, with dashes.
    file : str
        What the command line calls the file.
    """

    def parsed(text: str) -> float | dict[str, float]:
        if "=" not in text:
            return _number(text, option)
        pairs = [part.rpartition("=") for part in text.split(",")]
        if not all(label and value for label, _, value in pairs):
            raise OptionError(f"{option} {text} is not as in A=0.5,B=0.3")
        return {label.strip(): _number(value, option) for label, _, value in pairs}

    return {
        "parser": parsed,
        "metavar": "NUMBER|LABEL=NUMBER,...",
        "help": f"Of all particles of {file}, or of each label, as in A=0.5,B=0.3.",
        "shown": "that of the file",
    }


def edges(option: str) -> dict[str, Any]:
    """Return what `typer.Option` needs for the edges of a box.

    Parameters
    ----------
    option : str
        Its name, with dashes.
    """

    def parsed(text: str) -> tuple[float, ...]:
        return tuple(_number(edge, option) for edge in text.split(","))

    return {"parser": parsed, "metavar": "LX,LY[,LZ]"}


def units(file: str) -> Any:
    """Return the field for the units of a file, which the command line calls `file`."""
    return option(
        None,
        f"Units of {file}, where ASE converts them: numbers as in the file (reduced), or Angstrom, u and eV "
        "(ase).",
        shown="refused where it matters",
        **word("--units", "reduced", "ase"),
    )


def velocities_are(file: str) -> Any:
    """Return the field for the units of a column of velocities in a file."""
    return option(
        None,
        f"A column of velocities in {file} is in units of its lengths.",
        shown="refused where there is one",
        **word("--velocities-are", "reduced"),
    )


def own_box(file: str) -> Any:
    """Return the field for the box of a file that has none."""
    what = "a file of --from" if file == "--from" else "a file"
    return option(None, f"Edges of the box for {what} without one, as in 10,10,10.", **edges("--box"))


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


def whole_numbers(name: str, text: str) -> tuple[int, ...]:
    """Return the whole numbers, at least 1, with commas between them, that an option has.

    Raises
    ------
    OptionError
        If the text is anything else.
    """
    parts = text.split(",")
    if not all(part.strip().isdecimal() and int(part) >= 1 for part in parts) or len(parts) > MOST:
        raise OptionError(f"{name} {text} is not understood; give whole numbers from 1 on, with commas")
    return tuple(int(part) for part in parts)


def packing_fractions(text: str) -> tuple[float, ...]:
    """Return the packing fractions that a text names.

    Parameters
    ----------
    text : str
        Numbers with commas between them, or first:last:count for evenly spaced ones.

    Returns
    -------
    tuple of float
        Ascending, each once.

    Raises
    ------
    OptionError
        If the text is neither, or a number is not between 0 and 1.
    """
    import numpy as np

    try:
        if ":" in text:
            first, last, count = text.split(":")
            with np.errstate(invalid="ignore"):
                points = np.linspace(float(first), float(last), min(int(count), MOST + 1))
            values = [float(f"{value:.12g}") for value in points]
        else:
            values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if not values:
        raise OptionError(
            f"--packing-fraction {text} is not understood; give first:last:count, as in 0.01:0.49:9, or "
            "numbers with commas between them"
        )
    if len(values) > MOST:
        raise OptionError(f"--packing-fraction {text} are too many; ask for at most {MOST}")
    for value in values:
        if not 0.0 < value < 1.0:
            raise OptionError(f"--packing-fraction {text} has {value:g}; expected numbers between 0 and 1")
    return tuple(sorted(set(values)))


def densities(text: str, *, asked: bool = False) -> Any:
    """Return the field for the packing fractions of a study, given its default as it is typed.

    Parameters
    ----------
    text : str
        The default.
    asked : bool
        Whether the field tells that none were asked for: it is None then.
    """
    return option(
        None if asked else packing_fractions(text),
        "Volume fractions of the spheres: one, several with commas, or first:last:count.",
        flag="--packing-fraction",
        shown=text,
        parser=packing_fractions,
        metavar="NUMBER|LIST",
    )


def particles(count: int) -> Any:
    """Return the field for the number of particles."""
    return option(count, "Particles in each replica.", at_least=2)


def runs(count: int) -> Any:
    """Return the field for the number of replicas."""
    return option(count, "Independent runs of each gas; errors come from them.", at_least=1, at_most=MANY)


def seed() -> Any:
    """Return the field for the seed."""
    same = "the same seed gives the same results."
    return option(1, f"Source of every random choice: {same}", at_least=0)


def workers() -> Any:
    """Return the field for the number of processes."""
    return option(
        None,
        "Runs at once, in processes or threads; the results do not depend on it.",
        at_least=1,
        shown="all cores",
        matters=False,
    )


def threads() -> Any:
    """Return the field for the number of threads of each gas."""
    return option(
        1,
        "Threads that run each gas together, if it is large: from some 20 000 particles on. --workers is "
        "then 1 unless given, and --executor processes or threads. The results do not depend on it.",
        at_least=1,
        matters=False,
    )


def executor_named(text: str) -> str:
    """Return the name of an executor, see `studies.running.executors`; OptionError where there is none."""
    kind, _, address = text.partition(":")
    if kind == "dask" and not address.strip():
        raise OptionError(
            f"--executor {text} lacks the address of a scheduler, as in dask:tcp://host:8786, or its file"
        )
    if text not in ("processes", "threads", "mpi") and kind != "dask":
        raise OptionError(
            f"--executor {text} is not known; it can be processes, threads, dask:ADDRESS or mpi"
        )
    return text


def executor() -> Any:
    """Return the field for what runs the replicas."""
    return option(
        None,
        "What runs the replicas: processes, threads, dask:ADDRESS or mpi; the results do not depend on it.",
        shown="processes",
        matters=False,
        parser=executor_named,
        metavar="WORD",
        autocompletion=lambda: ["processes", "threads", "dask:tcp://", "mpi"],
    )


def dimension() -> Any:
    """Return the field for the dimension."""
    return option(3, "Dimension.", at_least=2, at_most=3)


OVER = "of a second species over the first's"


def mass_ratio(default: float = 1.0) -> Any:
    """Return the field for the mass of a second species."""
    its = positive("--mass-ratio", f"the mass {OVER}")
    return option(default, f"Mass {OVER}; 1: the same.", **its)


def diameter_ratio(default: float = 1.0) -> Any:
    """Return the field for the diameter of a second species."""
    its = positive("--diameter-ratio", f"the diameter {OVER}")
    return option(default, f"Diameter {OVER}; 1: the same.", **its)


def fraction() -> Any:
    """Return the field for the number fraction of a second species."""
    return option(None, "Number fraction of the second species.", at_least=0.0, at_most=1.0, shown="0.5")


PANELS = {
    "The gas": "gas n dim packing_fraction packing_fractions boundary start starts velocities temperature "
    "pressure diameter temperature_ratio mass_ratio diameter_ratio fraction source radius mass box units "
    "velocities_are mix scale_heights obstacles size",
    "What and how long": "collisions collisions_per_particle equilibration relaxation_times discard "
    "replicas runs transits reverse_after cells until_error suite rounds known quick size only against",
    "Results": "out force json figure_format frames animate",
    "The run itself": "config sweep seed workers threads executor checkpoint_every resume keep shard",
}
_PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
_WORDS, _FILES = ("units", "velocities_are", "executor"), ("source", "known")
_KIND_OF = (
    {"box": "NUMBERS"} | dict.fromkeys(_WORDS, "WORD") | dict.fromkeys(_FILES, "FILE")
)  # others: NUMBER
_SAME = {"packing-fractions": "packing-fraction"}  # old spellings of options


def rewrapped(text: str) -> str:
    """Join the lines of each paragraph, so that they can be wrapped to any width."""
    return "\n\n".join(re.sub(r"\s*\n\s*", " ", part) for part in inspect.cleandoc(text).split("\n\n"))


class _Command(TyperCommand):
    """A command whose options are shown briefly in panels."""

    def __init__(self, *args: Any, **named: Any) -> None:
        super().__init__(*args, **named)
        order = list(_PANEL_OF)
        self.params.sort(key=lambda its: order.index(str(its.name)) if its.name in order else -1)
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
            named.setdefault("help", rewrapped(function.__doc__ or ""))
            return super(App, self).command(name, cls=_Command, **named)(function)

        return registered
