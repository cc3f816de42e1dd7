"""What a notebook shows while something runs: an output that is replaced in place, and emptied."""

from __future__ import annotations

import html
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import timedelta

from rich.console import Console

__all__ = ["bar", "from_notebook", "in_notebook", "message"]

OFTEN = 0.25  # seconds between two states of a bar: each travels to the browser


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    return Console().is_jupyter


def from_notebook() -> bool:
    """Return whether a notebook started this process, as `!hardspheres ...` does.

    What looks like a terminal is none then: every state of a bar would be a line in the file of the notebook.
    """
    return "JPY_PARENT_PID" in os.environ


@contextmanager
def message(text: str) -> Iterator[Callable[[str, str], None]]:
    """Show a text while the context lasts.

    Yields
    ------
    callable
        Takes what stands there instead, as text and as HTML.
    """
    from IPython.display import display

    def content(text: str, page: str) -> dict[str, str]:
        return {"text/plain": text, "text/html": page}

    shown = display(content(text, html.escape(text)), raw=True, display_id=True)
    try:
        yield lambda text, page: shown.update(content(text, page), raw=True)
    finally:
        shown.update(content("", ""), raw=True)


@contextmanager
def bar(text: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar while the context lasts.

    Yields
    ------
    callable
        To be called after each step, without arguments.
    """
    began = told = time.monotonic()
    done = 0
    with message(f"{text} 0/{total}") as show:

        def advance() -> None:
            nonlocal told, done
            done, now = done + 1, time.monotonic()
            if now - told < OFTEN:
                return
            told, left = now, timedelta(seconds=round((now - began) / done * (total - done)))
            state = f"{done}/{total}, about {left} left"
            element = f'<progress value="{done}" max="{total}"></progress>'
            show(f"{text} {state}", f"{html.escape(text)} {element} {state}")

        yield advance
