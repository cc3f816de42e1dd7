"""How to cite this package: README.md says the same."""

__all__ = ["BIBTEX", "HOW"]

HOW = "Name the program, its version (`hardspheres --version`) and where you got it"

BIBTEX = """\
@software{hardspheres,
  author = {{The hardspheres authors}},
  title = {hardspheres: event-driven gases of hard spheres with error bars beside theory},
  year = {2026},
}
"""
