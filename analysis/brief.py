"""What a person is told of an object: a line, however many numbers are in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

__all__ = ["brief", "word"]

FEW = 4  # entries that are written out


def brief(self: Any) -> str:
    """Return the `repr` of a dataclass: its numbers, and of arrays how large they are."""
    shown = [(each.name, getattr(self, each.name)) for each in fields(self) if each.name[0] != "_"]
    return f"<{type(self).__name__}: {', '.join(f'{name} {word(value)}' for name, value in shown)}>"


def word(value: Any) -> str:
    """Return a value, or what kind it is and how large, in a few characters."""
    if isinstance(value, np.ndarray) and value.ndim:
        if value.size > FEW or value.ndim > 1:
            return f"{' x '.join(map(str, value.shape))} values"
        return f"[{', '.join(map(word, value))}]"
    if isinstance(value, (float, np.floating, np.ndarray)):
        return f"{float(value):.6g}"
    if isinstance(value, (list, tuple, Mapping)) and len(value) > FEW:
        return f"{len(value)} entries"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(word, value))}]"
    text = str(value)
    return text if len(text) < 100 else f"{text[:97]}..."
