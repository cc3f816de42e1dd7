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

from .candidates import note_candidate
from .chunks import clear_buckets
from .compiler import jit, prefetch
from .flags import DIM, WALLS
from .layout import (
    AGENDA_LENGTH,
    BUCKET,
    CANDIDATES,
    CELLS,
    HALF_WINDOW,
    LARGE,
    LINE_LANES,
    LINE_ROOM,
    MIDDLE,
    NODE_ROOM,
    NODES,
    SHORT_LISTS,
    SHORT_QUEUE,
    WINDOW_BUCKETS,
    N,
)
from .lines import LINE, PLACE, ZERO, line_at, meet_line, shifted, solve_meetings
from .prediction import wall_contact
from .rows import around, draft_line, meet_all, meet_rows, pieces_of, register_all, row_beside


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
    meet_all(s)
    if WALLS:
        for i in range(s.counter[N]):
            note_wall(s, i)


@jit
def note_wall(s, i):
    """Keep i's next wall as a candidate."""
    time, wall = wall_contact(s, i)
    if wall >= 0:
        note_candidate(s, i, wall, time)


@jit
def follow(s, i, now):
    """Find what happens to i, which has just changed, in the rest of the window, and chain its new line to its rows."""
    if WALLS:
        note_wall(s, i)
    middle, half = s.number[MIDDLE], s.number[HALF_WINDOW]
    duration = middle + half - now
    if duration <= 0.0:
        return
    since = np.float32((now - middle) / half - 1e-5)
    pieces = pieces_of(s, i, duration)
    draft = s.counter[N]
    for p in range(pieces):
        cell = draft_line(s, draft, i, now + duration * (p + 0.5) / pieces, pieces)
        meet_around(s, i, line_at(s.drafts, 1, draft * LINE), cell, since)
        solve_meetings(s)
        chain_draft(s, i, cell, ZERO)
        if DIM == 3:
            for step in range(-1, 2, 2):
                beside, shift = row_beside(s, cell, step)
                if beside >= 0:
                    chain_draft(s, i, beside, -shift)


@jit
def chain_draft(s, i, row, shift):
    """Add the new line, shifted along z, to the chain of a row."""
    node = s.counter[NODES]
    if node == s.counter[NODE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    s.counter[NODES] = node + 1
    draft = s.counter[N] * LINE
    for k in range(LINE):
        s.nodes[node * LINE + k] = s.drafts[draft + k]
    if DIM == 3:
        s.nodes[node * LINE + PLACE + 2] += shift
    s.node_ids[node] = i
    s.node_next[node] = s.row_chain[row]
    s.row_chain[row] = node


@jit
def meet_around(s, i, line, cell, since):
    """Compare a new line with all lines of its cell and the cells around."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    cx, cz, cy = cell // ny // nz, cell // ny % nz, cell % ny
    if s.counter[LARGE]:
        fetch_around(s, cx, cz, cy)
    for kx in range(cx - 1, cx + 2):
        x, sx = around(s, kx, 0)
        if x >= 0:
            row = (x * nz + cz) * ny
            meet_rows(s, row, cy, i, shifted(line, -sx, ZERO), since)
            for ky in range(cy - 1, cy + 2):
                y, sy = around(s, ky, 1)
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
def fetch_around(s, cx, cz, cy):
    """Have in the cache the lines around a cell, and the first of those chained to its rows."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    for kx in range(cx - 1, cx + 2):
        x, _ = around(s, kx, 0)
        if x >= 0:
            row = (x * nz + cz) * ny
            fetch_lines(s, row + max(cy - 1, 0))
            for ky in range(cy - 1, cy + 2):
                y, _ = around(s, ky, 1)
                if y >= 0:
                    prefetch(s.nodes, s.row_chain[row + y] * LINE)


@jit
def meet_chain(s, row, i, line, since):
    """Compare i's line with those chained to a row."""
    node = int(s.row_chain[row])
    while node >= 0:
        meet_line(s, s.nodes, s.node_ids, node, i, line, since)
        node = int(s.node_next[node])
