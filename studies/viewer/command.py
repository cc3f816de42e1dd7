"""`hardspheres view`: the gas in a file, moving, as a page."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

import hardspheres as hs
from studies.file_options import AboutAFile
from studies.options import OptionError, option
from studies.report import OutputError, OutputFolder, Screen
from studies.viewer.replay import view

__all__ = ["View"]

NONE = "is at rest: no frame has velocities; give a file that has them"


class _Page(OutputFolder):
    """The folder of the one file that is written."""

    def __init__(self, page: Path, force: bool) -> None:
        super().__init__(page.parent, force=force)
        self.page = page

    def check(self, study: Any = None, **_: bool) -> None:
        """Raise an error if the page cannot be written, or something else is in its place."""
        self._require_writable()
        if self.page.is_dir():
            raise OutputError(f"{self.page} is a folder; give the page another name with --out")
        if os.path.lexists(self.page) and not self.force:
            raise OutputError(f"{self.page} exists; give another name with --out, or --force to replace it")


@dataclass(frozen=True, kw_only=True)
class View(AboutAFile):
    """A page from a file."""

    name = "view"
    explanation = """
    FILE is a checkpoint (.npz, of Simulation.save), or a structure or trajectory, .gsd or what ASE reads, of
    which the first frame with velocities is taken. --out names the page, gas.html by default. Open it in any
    browser: it needs no network, and holds every collision.
    """
    files = ()
    resumable = False
    page = "gas.html"

    file: str = option("", "Structure, trajectory or checkpoint.", argument=True, metavar="FILE")
    collisions_per_particle: float = option(10.0, "How long to run, s = 2 collisions / n.")

    def folder(
        self, out: Path | None, checkpoint_every: float = 60.0, resume: bool = False, force: bool = False
    ) -> OutputFolder:
        """Return the folder of the page."""
        path = out or Path(self.page)
        if path.suffix.lower() not in (".html", ".htm"):
            raise OptionError(f"--out {path} must end in .html: it is a page for a browser")
        return _Page(path, force)

    def _start(self) -> hs.Scene | hs.Simulation:
        if Path(self.file).suffix == ".npz":
            names = [each.name for each in fields(AboutAFile) if getattr(self, each.name) is not None]
            if names:
                given = ", ".join(f"--{name.replace('_', '-')}" for name in names)
                raise OptionError(f"{self.file} is a checkpoint, which has everything; leave out {given}")
            return hs.Simulation.load(self.file)
        for scene in hs.read_trajectory(self.file, **vars(self.reading())):
            if np.any(scene.velocities):
                return scene
        raise hs.TrajectoryError(f"{self.file} {NONE}")

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Write the page."""
        page = out.page if isinstance(out, _Page) else out.path / self.page
        out.check(self, resumable=False)
        start = self._start()
        with screen.working("running the gas"):
            replay = view(start, self.collisions_per_particle)
        out.create()
        replay.save(page)
        size = page.stat().st_size
        screen.say(
            f"{replay.collisions} collisions of {replay.scene.n} particles: {page}, {size / 1e6:.2f} MB"
        )
        summary = {
            "study": "view",
            "file": self.file,
            "particles": replay.scene.n,
            "collisions": replay.collisions,
            "events": len(replay.events),
            "bytes": size,
            "files": [page.name],
        }
        return summary, True
