"""What the command line can run: options as fields, a name, an explanation, and the names of its files."""

from __future__ import annotations

import shlex
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import hardspheres as hs
from studies.options import OptionError, check_options, options_of, rewrapped
from studies.registry import QUESTIONS
from studies.report import OutputFolder, Screen, machine, today

__all__ = ["Program"]


@dataclass(frozen=True, kw_only=True)
class Program(ABC):
    """A command; subclasses are frozen dataclasses, their fields made by `studies.options.option`.

    Attributes
    ----------
    name : str
        On the command line.
    explanation : str
        What --help says after its first line.
    question : str
        What it asks, at the head of its report.
    files : tuple of str
        Everything that it writes beside summary.json and report.html; figures, which have any format, as
        .png.
    reports : bool
        Whether it writes report.html.
    resumable : bool
        Whether it keeps checkpoints.
    keeps : bool
        Whether its replicas may stay beside its results.
    to_an_error : bool
        Whether --until-error may decide the number of its replicas.
    sweeps : bool
        Whether --sweep may run it at several values of an option.
    in_shards : bool
        Whether --shard may run a part of it.
    only_if_asked : bool
        Whether it writes nothing, but for summary.json where --out names a folder.
    page : str
        Where --out names a single page instead of a folder: its name by default.
    """

    name: ClassVar[str]
    explanation: ClassVar[str]
    question: ClassVar[str] = ""
    files: ClassVar[tuple[str, ...]]
    reports: ClassVar[bool] = False
    resumable: ClassVar[bool] = True
    keeps: ClassVar[bool] = False
    to_an_error: ClassVar[bool] = False
    sweeps: ClassVar[bool] = False
    in_shards: ClassVar[bool] = False
    only_if_asked: ClassVar[bool] = False
    page: ClassVar[str] = ""

    def __init_subclass__(cls, **more: Any) -> None:
        """Keep `repr` as it is here, where a dataclass would list all options."""
        super().__init_subclass__(**more)
        if "__repr__" not in vars(cls):
            cls.__repr__ = Program.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        """Return the call that makes it; what was not given, and has no default or effect, is left out."""
        options = {each.name: getattr(self, each.name) for each in fields(self)}
        left_out = {
            each.name
            for each, its in options_of(self)
            if not its.matters and options[each.name] == each.default
        }
        given = ", ".join(
            f"{name}={value!r}"
            for name, value in options.items()
            if value is not None and name not in left_out
        )
        return f"{type(self).__name__}({given})"

    def __post_init__(self) -> None:
        """Refuse options beyond their limits."""
        check_options(self)

    def prepared(self, say: Callable[[str], object]) -> Self:
        """Return the program with every file read that it starts from, once; `say` takes remarks on them."""
        return self

    @property
    def asked(self) -> str:
        """Its question; where it has none, the first sentence of its explanation."""
        return self.question or rewrapped(self.explanation).split(". ")[0].rstrip(".") + "."

    @property
    def command(self) -> str:
        """The command that does the same, whole, but for where its files go and what changes no number."""
        listed = QUESTIONS.get(self.name, ("",))[0] == f"{type(self).__module__}:{type(self).__qualname__}"
        words = ["hardspheres", self.name] if listed else ["python", *_program_of(type(self))]
        for each, its in options_of(self):
            value = getattr(self, each.name)
            if its.matters and (value != each.default or each.name == "seed"):
                words += its.typed(each.name, value)
        return shlex.join(words)

    @property
    def chosen(self) -> dict[str, Any]:
        """Its options by the names of their fields, but for what changes no number."""
        return {each.name: getattr(self, each.name) for each, its in options_of(self) if its.matters}

    def made(self) -> dict[str, Any]:
        """Return what made its results, for its summary: command, version, date, machine and options."""
        return {
            "study": self.name,
            "command": self.command,
            "version": hs.__version__,
            "date": today(),
            "machine": machine(),
            "options": self.chosen,
        }

    @property
    def which(self) -> str:
        """What its folder is called after by default, beside its name."""
        return str(getattr(self, "seed", ""))

    def folder(
        self, out: Path | None, checkpoint_every: float = 60.0, resume: bool = False, force: bool = False
    ) -> OutputFolder:
        """Return the output folder for these options of the command line."""
        if resume and force:
            raise OptionError("--resume continues a run and --force replaces it; give one of them")
        path = out or Path("runs") / f"{self.name}-{self.which}"
        return OutputFolder(path, checkpoint_every=checkpoint_every, resume=resume, force=force)

    @abstractmethod
    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Run it, print its results and write its files.

        Parameters
        ----------
        out : OutputFolder
            Where the files go; made only after everything has been checked.
        screen : Screen
            Where results and progress are shown.

        Returns
        -------
        summary : dict
            The content of summary.json.
        sound : bool
            Whether no check failed.

        Raises
        ------
        HardSpheresError
            If options make no sense, or the folder cannot be written.
        """


def _program_of(kind: type[Program]) -> list[str]:
    """Return the words by which Python runs the file that a class is in; where there is none, its module."""
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return [Path(file).name] if file else ["-m", kind.__module__]
