"""The window method, for dilute gases: who can meet whom within a short common window of time.

In a window every flight is a known straight line, and few lines come near another. Each line is registered once, in the
cell that holds its middle (fast particles in several pieces, so that no piece reaches further than half a cell less a
contact distance), and compared with the lines of the cells around: do the two come within contact during the window?
That filter (`lines`, `rows`) runs in single precision with a safe margin; whatever passes it is computed exactly from the
rows, so the filter never enters the trajectory. True contacts become candidates (`candidates`). A particle that has collided
gets a new line, which is compared with those around it and then chained to the rows that it belongs to.

There are no events but collisions: nothing is done for particles that nobody meets, except to register them.
"""

import numpy as np

from .candidates import note_wall
from .chains import chain_draft, meet_chain
from .chunks import clear_buckets
from .compiler import jit, part, prefetch
from .flags import DIM, SIZES, WALLS
from .large import chain_large, clear_large, is_large, meet_large, meet_small
from .layout import (
    AGENDA_LENGTH,
    BEYOND_CACHE,
    BUCKET,
    CANDIDATES,
    CELLS,
    HALF_WINDOW,
    LARGE,
    LINE_LANES,
    LINE_ROOM,
    MIDDLE,
    NODES,
    SHORT_LISTS,
    SHORT_QUEUE,
    WINDOW_BUCKETS,
)
from .lines import ALL, LINE, ZERO, line_at, shifted, solve_meetings
from .rows import ALWAYS, around, draft_line, meet_all, meet_rows, pieces_of, register_all, row_at


@jit
def open_window(s, cells, chunks):
    """Register all lines and find all candidates of the window that begins in the current bucket."""
    s.counter[CANDIDATES] = 0
    s.counter[NODES] = 0
    s.counter[SHORT_LISTS] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[AGENDA_LENGTH] = 0
    clear_buckets(s, s.counter[WINDOW_BUCKETS], chunks)
    begin = s.counter[BUCKET] // s.counter[WINDOW_BUCKETS] * (2.0 * s.number[HALF_WINDOW])
    s.number[MIDDLE] = begin + s.number[HALF_WINDOW]
    register_all(s, cells, begin)
    if s.counter[SHORT_LISTS]:
        return
    if SIZES:
        register_large(s, begin)
        if s.counter[SHORT_LISTS]:
            return
    meet_all(s)


@part
def register_large(s, begin):
    """Hang the lines of all large particles in the coarse grid, compared with all small ones and with each other."""
    clear_large(s)
    duration = 2.0 * s.number[HALF_WINDOW]
    for k in range(s.counter[LARGE]):
        i = int(s.large[k])
        if WALLS:
            note_wall(s, i)
        pieces = pieces_of(s, i, duration)
        for p in range(pieces):
            time = begin + duration * (p + 0.5) / pieces
            draft_line(s, s.draft, 0, i, time, pieces)
            line = line_at(s.draft, 1, 0)
            meet_small(s, i, ALL, line, time, ALWAYS)
            meet_large(s, i, line, time, ALWAYS)
            chain_large(s, i, time, p == 0)
    if s.counter[SHORT_LISTS]:
        s.counter[NODES] = 0  # more lines than there is room for, and none that was replaced


@jit
def follow(s, i, other, now):
    """Find what happens to i, which has just met another particle (or -1, a wall), in the rest of the window, and chain its new line to its rows."""
    if WALLS:
        note_wall(s, i)
    middle, half = s.number[MIDDLE], s.number[HALF_WINDOW]
    duration = middle + half - now
    if duration <= 0.0:
        return
    since = np.float32((now - middle) / half - 1e-5)
    pieces = pieces_of(s, i, duration)
    for p in range(pieces):
        time = now + duration * (p + 0.5) / pieces
        x, y, z = draft_line(s, s.draft, 0, i, time, pieces)
        line = line_at(s.draft, 1, 0)
        large = is_large(s, i)
        if large:
            meet_small(s, i, other, line, time, since)
        else:
            meet_around(s, i, other, line, x, y, z, since)
        if SIZES:
            meet_large(s, i, line, time, since)
        solve_meetings(s)
        if large:
            chain_large(s, i, time, p == 0)
            continue
        chain_draft(s, i, row_at(s, x, y, z), ZERO)
        if DIM == 3:
            for step in range(-1, 2, 2):
                beside, shift = around(s, z + step, 2, CELLS)
                if beside >= 0:
                    chain_draft(s, i, row_at(s, x, y, beside), -shift)


@jit
def meet_around(s, i, other, line, cx, cy, cz, since):
    """Compare a new line with all lines of its cell and the cells around."""
    if s.counter[BEYOND_CACHE]:
        fetch_around(s, cx, cy, cz)
    for kx in range(cx - 1, cx + 2):
        x, sx = around(s, kx, 0, CELLS)
        if x >= 0:
            row = row_at(s, x, 0, cz)
            meet_rows(s, row, cy, i, other, shifted(line, -sx, ZERO), since)
            for ky in range(cy - 1, cy + 2):
                y, sy = around(s, ky, 1, CELLS)
                if y >= 0:
                    meet_chain(s, row + y, i, shifted(line, -sx, -sy), since)


@jit
def fetch_lines(s, row):
    """Have in the cache the first lines of a row, and those after them."""
    for column in range(LINE - 1):
        if DIM == 3 or not (column == 2 or column == 5):
            first = column * s.counter[LINE_ROOM] + s.row_start[row]
            prefetch(s.lines, first)
            prefetch(s.lines, first + LINE_LANES)


@jit
def fetch_around(s, cx, cy, cz):
    """Have in the cache the lines around a cell, and the first of those chained to its rows."""
    for kx in range(cx - 1, cx + 2):
        x, _ = around(s, kx, 0, CELLS)
        if x >= 0:
            row = row_at(s, x, 0, cz)
            fetch_lines(s, row + max(cy - 1, 0))
            for ky in range(cy - 1, cy + 2):
                y, _ = around(s, ky, 1, CELLS)
                if y >= 0:
                    prefetch(s.nodes, s.row_chain[row + y] * LINE)
