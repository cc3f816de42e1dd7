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

from .candidates import note_wall
from .chains import chain_at, chain_line, clear_chains, meet_chains
from .chunks import clear_buckets
from .compiler import jit, part
from .drafts import pieces_of, write_draft
from .flags import DIM, SIZES, WALLS
from .large import chain_large, clear_large, is_large, meet_large, meet_small
from .layout import (
    AGENDA_LENGTH,
    BUCKET,
    CANDIDATES,
    CELLS,
    HALF_WINDOW,
    LARGE,
    MIDDLE,
    NODES,
    SHORT_LISTS,
    SHORT_QUEUE,
    WINDOW_BUCKETS,
)
from .line_cells import (
    ALWAYS,
    SEVERAL,
    around,
    column_at,
    forget_images,
    meet_all,
    meet_column,
    register_all,
    replace_line,
)
from .lines import SAME, examine, new_line


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
    clear_chains(s)
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
    for a in range(s.counter[LARGE]):
        i = int(s.large[a])
        s.where[i] = SEVERAL
        if WALLS:
            note_wall(s, i)
        pieces = pieces_of(s, i, duration)
        for p in range(pieces):
            time = begin + duration * (p + 0.5) / pieces
            draft_new(s, i, time, duration, pieces)
            m = meet_large(s, meet_small(s, 0, i, time), i, time)
            examine(s, m, ALWAYS)
            forget_images(s, m)
            chain_large(s, i, time, p == 0)
    if s.counter[SHORT_LISTS]:
        s.counter[NODES] = 0  # more lines than there is room for, and none that was replaced


@jit
def follow(s, i, now):
    """Find what happens to i, whose row has just changed, in the rest of the window, and register its new line."""
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
        x, y, z = draft_new(s, i, time, duration, pieces)
        large = is_large(s, i)
        m = meet_small(s, 0, i, time) if large else meet_around(s, x, y, z)
        if SIZES:
            m = meet_large(s, m, i, time)
        examine(s, m, since)
        forget_images(s, m)
        if large:
            chain_large(s, i, time, p == 0)
        elif pieces > 1 or not replace_line(s, i, x, y, z):
            chain_line(s, chain_at(s, x, y, z))


@jit
def draft_new(s, i, t, duration, pieces):
    """Write i's new line."""
    return write_draft(s, s.lines, s.line_words, s.bounds, new_line(s), i, t, duration, pieces)


@jit
def meet_around(s, cx, cy, cz):
    """Enter the pairs of the new line and all whose bounds overlap in its cell and the cells around; returns how many there are."""
    ny, new = s.counter[CELLS + 1], new_line(s)
    m = 0
    for ox in range(-1, 2):
        x, image_x = around(s, cx + ox, 0, CELLS)
        for oz in range(-1 if DIM == 3 else 0, 2 if DIM == 3 else 1):
            z, image_z = around(s, cz + oz, 2, CELLS)
            if x >= 0 and z >= 0:
                code = SAME + image_x + image_z
                m = meet_column(s, m, new, new + 1, column_at(s, x, z), cy, code)
                m = meet_chains(s, m, x, z, max(cy - 1, 0), min(cy + 1, ny - 1), code)
                if cy == 0 or cy == ny - 1:
                    beyond, image_y = around(s, cy - 1 if cy == 0 else cy + 1, 1, CELLS)
                    if beyond >= 0:
                        m = meet_chains(s, m, x, z, beyond, beyond, code + image_y)
    return m
