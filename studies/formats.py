"""Formats of figures."""

from __future__ import annotations

from typing import Any

__all__ = ["FORMATS", "in_format"]

FORMATS: dict[str, Any] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}
"""Formats of figures, with the metadata that would differ from day to day left out."""


def in_format(name: str, form: str) -> str:
    """Return the name of a file where figures have this format: of .png another ending, else the same."""
    return f"{name.removesuffix('png')}{form}" if name.endswith(".png") else name
