"""Options from a file: the summary of an earlier run, or TOML with the same names as on the command line.

They take the place of the defaults, so that an option on the command line wins.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin

from studies.options import Option, OptionError, in_words, options_of
from studies.registry import QUESTIONS

if TYPE_CHECKING:
    import typer

    from studies.program import Program

__all__ = ["Config", "Parameter", "configure", "parameters_of"]

SUMMARY = "summary.json"
NEVER = {"config", "help"}  # in a file
EXPECTED = {bool: "true or false", int: "a whole number", float: "a number", str: "a text"}


@dataclass(frozen=True)
class Config:
    """A file that options were taken from.

    Attributes
    ----------
    file : str
        Its name.
    remarks : tuple of str
        What is to be known about it.
    """

    file: str
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Parameter:
    """A parameter of a command, and the values that it takes.

    Attributes
    ----------
    name, flag : str
        Of the function, and on the command line.
    kind : type
        bool, int, float or str; of what `parser` makes, it says nothing.
    parser : callable or None
        Makes the value of a text.
    several : bool
        Whether it may be given several times.
    option : Option or None
        Of the field of the study, where it is one.
    at_least : float or None
        Limit of what is no field.
    """

    name: str
    flag: str
    kind: type
    parser: Callable[[str], Any] | None
    several: bool
    option: Option | None
    at_least: float | None = None

    def of_text(self, text: str) -> Any:
        """Return the value of a text as it is typed; OptionError where there is none."""
        found: Any
        try:
            if self.parser is not None:
                found = self.parser(text)
            elif self.kind is bool:
                found = {"true": True, "false": False}[text.lower()]
            else:
                found = self.kind(text)
        except (ValueError, KeyError):
            raise OptionError(f"{self.flag} {text} is not {EXPECTED[self.kind]}") from None
        if self.option is not None:
            self.option.check(self.name, found)
        elif self.at_least is not None and not found >= self.at_least:
            raise OptionError(f"{self.flag} {text} is out of range; ask for at least {self.at_least:g}")
        return found

    def typed(self, value: Any) -> Any:
        """Return a value of JSON or TOML as it would be typed; OptionError where it makes no sense."""
        if self.several:
            return [self._typed(each) for each in (value if isinstance(value, list) else [value])]
        return self._typed(value)

    def _typed(self, value: Any) -> Any:
        text = value if isinstance(value, str) else in_words(value)
        if self.parser is None:
            right = type(value) is self.kind or (self.kind is float and type(value) is int)
        else:
            right = _plain(value)
        if not right:
            shown = value if isinstance(value, str) else json.dumps(value, default=str)
            what = EXPECTED[self.kind] if self.parser is None else "a text or numbers"
            raise OptionError(f"{self.flag} {shown:.60}: {what} is expected")
        if self.kind is bool:
            return value
        found = self.of_text(text)
        if isinstance(value, Mapping) and found != value:
            raise OptionError(f"{self.flag} {text}: labels with ',' or '=' cannot be told apart here")
        return text


def _plain(value: Any) -> bool:
    """Return whether a value of a file can be typed: a text, a number, several of them, or one a label."""
    if isinstance(value, Mapping):
        return all(type(each) in (int, float) for each in value.values())
    parts = value if isinstance(value, list) else [value]
    return all(type(each) in (int, float, str) for each in parts)


def parameters_of(kind: type[Program], declared: Mapping[str, Any], ctx: typer.Context) -> list[Parameter]:
    """Return the parameters of the command of a study.

    Parameters
    ----------
    kind : type
        The study's class.
    declared : mapping
        Annotated type and default of each parameter of the command's function.
    ctx : typer.Context
        Of the call.
    """
    fields = {each.name: its for each, its in options_of(kind)}
    found = []
    for param in ctx.command.params:
        name = str(param.name)
        if name in NEVER or name not in declared:
            continue
        annotation, info = get_args(declared[name][0])[:2]
        members = [each for each in (annotation, *get_args(annotation)) if isinstance(each, type)]
        several = any(get_origin(each) is list for each in (annotation, *get_args(annotation)))
        inner = [each for part in get_args(annotation) for each in get_args(part)] if several else members
        plain = next((each for each in (bool, int, float) if each in inner), str)
        flag = max(param.opts, key=len) if param.param_type_name == "option" else name.upper()
        parser, least = getattr(info, "parser", None), getattr(info, "min", None)
        found.append(Parameter(name, flag, plain, parser, several, fields.get(name), least))
    return found


def named(parameters: list[Parameter], name: str) -> Parameter | None:
    """Return the parameter that a name means: its flag without dashes, or the name of its field."""
    wanted = name.replace("_", "-").lower()
    for each in parameters:
        if wanted in (each.flag.lstrip("-").lower(), each.name.replace("_", "-")):
            return each
    return None


def configure(kind: type[Program], declared: Mapping[str, Any], ctx: typer.Context, file: str) -> Config:
    """Make the options in a file the defaults of a command.

    Parameters
    ----------
    kind, declared, ctx
        As in `parameters_of`.
    file : str
        A summary.json, its folder, or TOML.

    Raises
    ------
    OptionError
        If it cannot be read, or an option in it is unknown, of a wrong type or out of range; if it is the
        summary of another study.
    """
    content, remarks = _read(Path(file), kind.name)
    parameters, values = parameters_of(kind, declared, ctx), {}
    for name, value in content.items():
        its = named(parameters, name)
        if its is None:
            raise OptionError(f"{file}: {kind.name} has no option {name}; --help lists all")
        if its.name in values:
            raise OptionError(f"{file}: {its.flag} is given twice, once as {name}; give it once")
        if value is None:
            continue
        try:
            values[its.name] = its.typed(value)
        except OptionError as error:
            raise OptionError(f"{file}: {error}") from None
    ctx.default_map = {**(ctx.default_map or {}), **values}
    return Config(file, tuple(remarks))


def _read(path: Path, study: str) -> tuple[dict[str, Any], list[str]]:
    """Return the options in a file by their names, and remarks."""
    if path.is_dir():
        path = path / SUMMARY
    summary = path.suffix.lower() == ".json"
    try:
        raw = path.read_bytes()
    except (OSError, ValueError) as error:
        raise OptionError(f"--config {path} cannot be read: {getattr(error, 'strerror', error)}") from None
    try:
        found = json.loads(raw) if summary else tomllib.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        form = "JSON" if summary else "TOML"
        raise OptionError(f"--config {path} is not {form}: {error}".replace("\n", " ")) from None
    if not summary:
        _of_study(path, found.pop("study", study), study)
        return found, []
    options = found.get("options") if isinstance(found, dict) else None
    if not isinstance(options, dict) or not isinstance(found.get("study"), str):
        raise OptionError(f"--config {path} is no summary of a run with options; give a {SUMMARY}, or TOML")
    _of_study(path, found["study"], study)
    return options, _of_version(path, found.get("version"))


def _of_study(path: Path, found: Any, study: str) -> None:
    """Raise OptionError where a file is of another study."""
    if found != study:
        other = f"; that is hardspheres {found} --config {path}" if found in QUESTIONS else ""
        raise OptionError(f"--config {path} is of the study {found}, and this is {study}{other}")


def _of_version(path: Path, version: Any) -> list[str]:
    from hardspheres import __version__

    if version == __version__:
        return []
    told = f"{path} is of hardspheres {version}, and this is {__version__}"
    return [f"{told}: under Changed bits CHANGELOG.md says whether the numbers are the same to the last bit"]
