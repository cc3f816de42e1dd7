"""What the command line can run: options as fields, a name, an explanation, and the names of its files."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

from studies.options import OptionError, check_options
from studies.report import OutputFolder, Screen

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
    files : tuple of str
        Everything that it writes beside summary.json.
    resumable : bool
        Whether it keeps checkpoints.
    to_an_error : bool
        Whether --until-error may decide the number of its replicas.
    only_if_asked : bool
        Whether it writes nothing, but for summary.json where --out names a folder.
    page : str
        Where --out names a single page instead of a folder: its name by default.
    """

    name: ClassVar[str]
    explanation: ClassVar[str]
    files: ClassVar[tuple[str, ...]]
    resumable: ClassVar[bool] = True
    to_an_error: ClassVar[bool] = False
    only_if_asked: ClassVar[bool] = False
    page: ClassVar[str] = ""

    def __post_init__(self) -> None:
        """Refuse options beyond their limits."""
        check_options(self)

    def prepared(self, say: Callable[[str], object]) -> Self:
        """Return the program with every file read that it starts from, once; `say` takes remarks on them."""
        return self

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
