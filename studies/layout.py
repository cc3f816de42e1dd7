"""Layout of tables and sentences in a given width: long ones take several lines, and no cell is cut."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

__all__ = ["Block", "table_blocks", "wrapped"]

Block = tuple[list[str], list[str]]  # lines of the header, lines of the body

WITH_THE_ONE_BEFORE = {"theory", "z", "growth", "best", "ratio", ""}
"""Columns that qualify the column before them, and stay beside it where possible."""


def wrapped(text: str, width: int | None, indent: str = "") -> list[str]:
    """Break a sentence between words; a word that is longer than a line stays whole.

    Parameters
    ----------
    text : str
        One or more lines.
    width : int or None
        Characters in a line; None wraps nothing.
    indent : str
        What the second and further lines begin with.

    Returns
    -------
    list of str
    """
    if width is None:
        return text.split("\n")
    broken = []
    for line in text.split("\n"):
        broken += textwrap.wrap(
            line,
            width,
            subsequent_indent=indent,
            break_long_words=False,
            break_on_hyphens=False,
        ) or [""]
    return broken


def table_blocks(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    width: int,
    keys: int = 1,
    wrap: bool = False,
) -> list[Block]:
    """Lay out a table in a given width.

    It is one block where it fits. Where it does not, cells of words are broken between words if `wrap` asks
    for it; else the columns are spread over several blocks, each with the key columns; and where not even
    that fits, each row becomes a block of its own with a line for each column.

    Parameters
    ----------
    columns : sequence of str
        Titles.
    rows : sequence of sequence of str
        Cells.
    width : int
        Characters in a line.
    keys : int, default 1
        How many of the first columns name a row.
    wrap : bool, default False
        Whether cells are sentences rather than numbers.

    Returns
    -------
    list of Block
        Header and body of each block; lines are at most `width` long unless a single word is longer.
    """
    cells = [list(columns), *([*row] for row in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(columns))]
    everything = list(range(len(columns)))
    if _total(widths, everything) <= width:
        return [_block(cells, widths, everything, width)]
    if wrap:
        words = [max((len(word) for row in cells for word in row[k].split()), default=0) for k in everything]
        if _total(words, everything, gap=2) <= width:
            return [_wrapped_block(cells, _shared(words, widths, width))]
        return _records(cells, width, keys)
    blocks = _spread(columns, widths, width, keys, gap=2) or _spread(columns, widths, width, keys, gap=1)
    if blocks is None:
        return _records(cells, width, keys)
    return [_block(cells, widths, block, width) for block in blocks]


def _total(widths: Sequence[int], chosen: Sequence[int], gap: int = 1) -> int:
    return sum(widths[k] for k in chosen) + gap * (len(chosen) - 1)


def _block(cells: list[list[str]], widths: list[int], chosen: Sequence[int], width: int) -> Block:
    """Return chosen columns, aligned to the right."""
    gap = "  " if _total(widths, chosen, gap=2) <= width else " "
    header, *body = [gap.join(row[k].rjust(widths[k]) for k in chosen).rstrip() for row in cells]
    return [header], body


def _spread(
    columns: Sequence[str], widths: list[int], width: int, keys: int, gap: int
) -> list[list[int]] | None:
    """Return the columns of each block, key columns first; None if one column beside them is too wide."""
    first = list(range(keys))
    groups: list[list[int]] = []
    for k in range(keys, len(columns)):
        if groups and columns[k] in WITH_THE_ONE_BEFORE:
            groups[-1].append(k)
        else:
            groups.append([k])
    fitting: list[list[int]] = []
    for group in groups:
        whole = _total(widths, [*first, *group], gap) <= width
        fitting += [group] if whole else [[k] for k in group]
    blocks = [[*first]]
    for group in fitting:
        if _total(widths, [*first, *group], gap) > width:
            return None
        if len(blocks[-1]) > keys and _total(widths, [*blocks[-1], *group], gap) > width:
            blocks.append([*first])
        blocks[-1] += group
    return blocks


def _shared(least: list[int], most: list[int], width: int) -> list[int]:
    """Return widths between longest word and whole cell that balance the heights of the columns."""
    widths = least.copy()
    while _total(widths, range(len(widths)), gap=2) < width:
        widths[max(range(len(widths)), key=lambda k: most[k] / max(widths[k], 1))] += 1
    return widths


def _wrapped_block(cells: list[list[str]], widths: list[int]) -> Block:
    """Return all columns, aligned to the left, their cells broken between words."""
    rows = []
    for row in cells:
        parts = [wrapped(cell, wide) if cell else [""] for cell, wide in zip(row, widths, strict=True)]
        for line in range(max(map(len, parts))):
            shown = [part[line] if line < len(part) else "" for part in parts]
            rows.append(
                "  ".join(text.ljust(wide) for text, wide in zip(shown, widths, strict=True)).rstrip()
            )
        if row is cells[0]:
            header, rows = rows, []
    return header, rows


def _records(cells: list[list[str]], width: int, keys: int) -> list[Block]:
    """Return one block for each row: its keys above, then a line or more for each other cell."""
    columns, *rows = cells
    blocks: list[Block] = []
    before = [""] * keys
    for row in rows:
        before = [now or then for now, then in zip(row[:keys], before, strict=True)]
        named = [f"{name} {cell}".strip() for name, cell in zip(columns[:keys], before, strict=True)]
        body = []
        for name, cell in zip(columns[keys:], row[keys:], strict=True):
            if cell:
                body += wrapped(f"  {name}: {cell}" if name else f"  {cell}", width, "    ")
        blocks.append((wrapped(", ".join(named), width), body))
    return blocks
