"""The window method, for dilute gases: who can meet whom within a short common window of time.

In a window every flight is a known straight line, and few lines come near another. Each line is registered once, in the
cell that holds its middle (fast particles in several pieces, so that no piece reaches further than half a cell less a
contact distance), and compared with the lines of the cells around (`line_cells`): first their bounds, in bytes, then whether
the two come within contact during the window (`lines`). These filters run with a safe margin; whatever passes them is computed
exactly from the rows, so the filters never enter the trajectory. True contacts become candidates (`candidates`). A particle that
has collided gets a new line, which is compared with those around it and then takes the place of the old one, or is chained to
those of its cell (`chains`).

There are no events but collisions: nothing is done for particles that nobody meets, except to register them.
"""

import numpy as np

from ..common.bucket_queue import clear_buckets
from ..flags import SIZES, WALLS
from ..layout import (
    BEYOND_ALL,
    BEYOND_CACHE,
    BUCKET,
    CANDIDATES,
    CELLS,
    HALF_WINDOW,
    HEAP_LENGTH,
    IMAGE,
    INVERSE,
    LARGE,
    LINE,
    MIDDLE,
    NEAR_SHIFT,
    NODES,
    SHORT_LISTS,
    SHORT_QUEUE,
    WINDOW_BUCKETS,
)
from ..simd.jit import called, jit
from ..simd.pointers import int64, prefetch
from ..simd.vectors import AT_ONCE
from .cells import ALWAYS, SEVERAL, meet_all, meet_column, register_all, replace_line, withdraw
from .filter import examine, examine_table, new_line
from .grid import cells_along_y, columns_around
from .large import chain_large, clear_large, is_large, meet_large, meet_small
from .overflow import chain_at, chain_line, clear_chains, meet_chains
from .predicted_contacts import note_wall
from .segments import pieces_of, write_draft

# Of each of the particles that an event has changed, int64.
WHO = 0
PIECES = 1  # in which its new flight is registered
CELL = 2  # that holds the middle of the present piece, 3 slots
FIRST = 5  # first and last cell along y near it
PLACES = 7  # how many columns are near it
CHANGED = 8
MOST_PLACES = 16  # in the table of columns


@jit
def open_window(s, cells, blocks):
    """Register all lines and find all candidates of the window that begins in the current bucket."""
    s.counter[CANDIDATES] = 0
    s.counter[NODES] = 0
    s.counter[SHORT_LISTS] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[HEAP_LENGTH] = 0
    clear_buckets(s, s.counter[WINDOW_BUCKETS], blocks)
    begin = s.counter[BUCKET] // s.counter[WINDOW_BUCKETS] * (2.0 * s.number[HALF_WINDOW])
    s.number[MIDDLE] = begin + s.number[HALF_WINDOW]
    clear_chains(s)
    register_all(s, cells, begin)
    if s.counter[SHORT_LISTS]:
        return
    if SIZES:
        register_large(s, begin)
        if s.counter[SHORT_LISTS]:
            return
    meet_all(s)


@called
def register_large(s, begin):
    """Hang the lines of all large particles in the coarse grid, compared with all small ones and with each other."""
    clear_large(s)
    duration = 2.0 * s.number[HALF_WINDOW]
    new = new_line(s)
    for a in range(s.counter[LARGE]):
        i = int64(s.large[a])
        s.where[i] = SEVERAL
        if WALLS:
            note_wall(s, i)
        pieces = pieces_of(s, i, duration)
        for p in range(pieces):
            time = begin + duration * (p + 0.5) / pieces
            draft_new(s, new, i, time, duration, pieces)
            m = meet_large(s, meet_small(s, 0, i, new, time), i, new, time)
            examine_table(s, m, ALWAYS)
            chain_large(s, i, new, time, p == 0)
    if s.counter[SHORT_LISTS]:
        s.counter[NODES] = 0  # more lines than there is room for, and none that was replaced


@jit
def follow(s, i, j, now):
    """Find what happens to i and j (or -1), whose rows have just changed, in the rest of the window, and register their new lines.

    Both at once, since each step of a search waits for the one before, but not for those of the other. Then they do not see
    each other, but they fly apart; flights in pieces, which may lead round the box, come one after the other.
    """
    duration = s.number[MIDDLE] + s.number[HALF_WINDOW] - now
    changed = 2 if j >= 0 else 1
    s.changed[WHO], s.changed[CHANGED + WHO] = i, j
    s.changed[CHANGED + PIECES] = 0
    most = 0
    for a in range(changed):
        who = s.changed[a * CHANGED + WHO]
        withdraw(s, who)
        if WALLS:
            note_wall(s, who)
        pieces = pieces_of(s, who, duration) if duration > 0.0 else 0
        s.changed[a * CHANGED + PIECES] = pieces
        most = max(most, pieces)
    apart = most > 1
    for step in range(s.changed[PIECES] + s.changed[CHANGED + PIECES] if apart else most):
        second = step >= s.changed[PIECES]
        begin = 1 if apart and second else 0
        end = begin + 1 if apart else changed
        follow_piece(s, begin, end, step - s.changed[PIECES] if second else step, now, duration)


@jit
def follow_piece(s, begin, end, p, now, duration):
    """Find what happens in one piece of the new flights from `begin` to `end`, and register these pieces."""
    since = np.float32((now - s.number[MIDDLE]) / s.number[HALF_WINDOW] - 1e-5)
    for a in range(begin, end):
        draft_piece(s, a, p, now, duration)
        find_runs(s, a)
    m = int64(0)
    for a in range(begin, end):
        m = meet_piece(s, m, a, p, now, duration)
    examine(s, m, since)
    for a in range(begin, end):
        register_piece(s, a, p, now, duration)


@jit
def middle_of_piece(s, a, p, now, duration):
    """Time at the middle of a piece of a new flight."""
    return now + duration * (p + 0.5) / s.changed[a * CHANGED + PIECES]


@jit
def draft_piece(s, a, p, now, duration):
    """Write the new line of a piece of a new flight."""
    i, pieces = s.changed[a * CHANGED + WHO], s.changed[a * CHANGED + PIECES]
    x, y, z = draft_new(s, new_line(s) + a, i, middle_of_piece(s, a, p, now, duration), duration, pieces)
    cell = a * CHANGED + CELL
    s.changed[cell], s.changed[cell + 1], s.changed[cell + 2] = x, y, z


@jit
def cell_of_piece(s, a):
    """Cell that holds the middle of a piece."""
    return s.changed[a * CHANGED + CELL], s.changed[a * CHANGED + CELL + 1], s.changed[a * CHANGED + CELL + 2]


@jit
def meet_piece(s, m, a, p, now, duration):
    """Enter the pairs of a new line and those near it in the table, which has m; returns how many it has."""
    if SIZES:
        i, new = s.changed[a * CHANGED + WHO], new_line(s) + a
        time = middle_of_piece(s, a, p, now, duration)
        m = meet_small(s, m, i, new, time) if is_large(s, i) else meet_around(s, m, a)
        return meet_large(s, m, i, new, time)
    return meet_around(s, m, a)


@jit
def register_piece(s, a, p, now, duration):
    """Register a new line: in the place of the old one, or in a chain."""
    i, new = s.changed[a * CHANGED + WHO], new_line(s) + a
    if SIZES and is_large(s, i):
        chain_large(s, i, new, middle_of_piece(s, a, p, now, duration), p == 0)
        return
    x, y, z = cell_of_piece(s, a)
    if s.changed[a * CHANGED + PIECES] > 1 or not replace_line(s, i, new, x, y, z):
        chain_line(s, new, chain_at(s, x, y, z))


@jit
def draft_new(s, new, i, t, duration, pieces):
    """Write i's new line."""
    return write_draft(s, s.lines, s.line_words, s.bounds, new, i, t, duration, pieces)


@jit
def find_runs(s, a):
    """Find the columns with lines that may overlap a new line, and prefetch the first segments of each."""
    x, y, z = cell_of_piece(s, a)
    near = s.bounds[new_line(s) + a] >> NEAR_SHIFT
    first, last = cells_along_y(s, near, y)
    s.changed[a * CHANGED + FIRST], s.changed[a * CHANGED + FIRST + 1] = first, last
    begin = a * MOST_PLACES
    k = columns_around(s, begin, near, x, z)
    s.changed[a * CHANGED + PLACES] = k - begin
    if s.counter[BEYOND_CACHE]:
        for place in range(begin, k):
            column = int64(s.column[s.places[place]])
            start = s.cell_count[column * s.counter[CELLS + 1] + max(first, 0)]
            prefetch(s.bounds, start)
            prefetch(s.bounds, start + AT_ONCE // 2)


@jit
def meet_around(s, m, a):
    """Enter the pairs of a new line and all whose bounds overlap near it; returns how many there are."""
    new, begin = new_line(s) + a, a * MOST_PLACES
    first, last = s.changed[a * CHANGED + FIRST], s.changed[a * CHANGED + FIRST + 1]
    for k in range(begin, begin + s.changed[a * CHANGED + PLACES]):
        column, code = int64(s.column[s.places[k]]), int64(s.column_code[s.places[k]])
        before = m
        m = meet_column(s, m, new, column, first, last, 0, code)
        if s.counter[BEYOND_ALL]:
            for pair in range(before, m):
                prefetch(s.lines, s.pair_slot[pair] * LINE)
        m = meet_chains_around(s, m, new, column, first, last, code)
    return m


@jit
def meet_chains_around(s, m, new, column, first, last, code):
    """Enter the pairs with lines chained to these cells of a column, which may lie beyond the box; returns how many there are."""
    ny = s.counter[CELLS + 1]
    m = meet_chains(s, m, new, column, max(first, 0), min(last, ny - 1), code)
    if s.number[INVERSE + 1] > 0.0:
        if first < 0:
            m = meet_chains(s, m, new, column, max(first + ny, 0), ny - 1, code + IMAGE[1])
        if last >= ny:
            m = meet_chains(s, m, new, column, 0, min(last - ny, ny - 1), code - IMAGE[1])
    return m
