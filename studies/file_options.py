"""Options of a program that is about one file: what the file leaves open."""

from __future__ import annotations

from dataclasses import dataclass

from hardspheres.files import Reading
from studies.fluid import Boundary
from studies.options import boundary, of_labels, option, own_box, units, velocities_are
from studies.program import Program

__all__ = ["AboutAFile"]


@dataclass(frozen=True, kw_only=True)
class AboutAFile(Program):
    """A program whose subclasses have a field `file`."""

    radius: float | dict[str, float] | None = option(None, **of_labels("--radius", "FILE"))
    mass: float | dict[str, float] | None = option(None, **of_labels("--mass", "FILE"))
    units: str | None = units("FILE")
    velocities_are: str | None = velocities_are("FILE")
    box: tuple[float, ...] | None = own_box("FILE")
    boundary: Boundary | None = option(None, **boundary, shown="periodic, with --box")
    dim: int | None = option(
        None,
        "2: FILE is of discs, whose z differ by at most 1e-6 diameters.",
        at_least=2,
        at_most=3,
        shown="that of the file",
    )

    def reading(self) -> Reading:
        """Return how the file is interpreted."""
        given = self.units or self.velocities_are
        return Reading(self.radius, self.mass, given, self.box, self.boundary, self.dim)
