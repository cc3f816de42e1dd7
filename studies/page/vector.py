"""Figures as vector graphics within a page."""

from __future__ import annotations

import re
from html import escape
from io import BytesIO
from typing import TYPE_CHECKING

from studies.figures.style import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["inline_svg", "titles"]

MANY = 12  # panels
_DROPPED = re.compile(r"<!--.*?-->|<metadata>.*?</metadata>|<defs>\s*<style.*?</defs>", re.DOTALL)
_REFERENCE = re.compile(r'(?<=xlink:href="#)[^"]+|(?<=url\(#)[^)]+')
_ID = re.compile(r' id="([^"]*)"')
_SIZE = re.compile(r' (?:width|height)="[^"]*pt"')


def titles(figure: Figure) -> str:
    """Return the titles of all panels, without marks of mathematics; of very many, their number."""
    every = [axes.get_title(loc) for axes in figure.axes for loc in ("left", "center", "right")]
    found = list(dict.fromkeys(filter(None, every)))
    return "; ".join(found).replace("$", "") if len(found) <= MANY else f"{len(found)} panels"


def inline_svg(figure: Figure, label: str, prefix: str) -> str:
    """Return a figure as an <svg> element that can stand beside others in one page.

    Parameters
    ----------
    figure : Figure
        With the name of its gas.
    label : str
        What it shows, for those who cannot see it.
    prefix : str
        What its ids begin with; no other figure of the page has it.

    Returns
    -------
    str
        Text is drawn as outlines, so that it looks the same everywhere. The style that matplotlib gives to
        all elements of a page is left to the page.
    """
    file = BytesIO()
    save(figure, file, "svg")
    whole = file.getvalue().decode("utf-8")
    text = _DROPPED.sub("", whole[whole.index("<svg") :])
    names = {name: f"{prefix}{k}" for k, name in enumerate(dict.fromkeys(_REFERENCE.findall(text)))}
    text = _REFERENCE.sub(lambda found: names[found[0]], text)
    text = _ID.sub(lambda found: f' id="{names[found[1]]}"' if found[1] in names else "", text)
    head, _, body = text.partition(">")
    return f'{_SIZE.sub("", head)} role="img" aria-label="{escape(label)}">{body.strip()}'
