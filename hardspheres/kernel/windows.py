"""The window method, for dilute gases: who can meet whom within a short common window of time.

In a window every flight is a known straight line, and few lines come near another. Each line is registered once, in the
cell that holds its middle (fast particles in several pieces, so that no piece reaches further than half a cell less a
contact distance), and compared with the lines of the cells around: do the two come within contact during the window?
That filter (`lines`, `planes`) runs in single precision with a safe margin; whatever passes it is computed exactly from the
rows, so the filter never enters the trajectory. True contacts become candidates (`candidates`). A particle that has collided
gets a new line, which is compared with those around it and then chained to its cell.

There are no events but collisions: nothing is done for particles that nobody meets, except to register them.
"""

import math

import numpy as np

from .candidates import note_candidate
from .compiler import jit, prefetch
from .flags import DIM, WALLS
from .layout import (
    AGENDA_LENGTH,
    BUCKET,
    CANDIDATES,
    CELLS,
    HALF_WINDOW,
    INVERSE,
    LINE_ROOM,
    LINES,
    MIDDLE,
    REGISTERED,
    ROW,
    SHORT_CELLS,
    SHORT_LISTS,
    SHORT_QUEUE,
    STRETCH,
    WINDOW_BUCKETS,
    N,
    V,
)
from .lines import cell_at, line_at, meet_line, meet_run, write_line
from .planes import ZERO, around, meet_all
from .prediction import wall_contact

MANY = 1000000  # pieces; more than anybody can need
AHEAD = 12  # particles from here to that whose row is fetched


@jit
def pieces_of(s, i, duration):
    """In how many pieces a flight of this duration is registered, so that none reaches further than STRETCH both ways."""
    vv = 0.0
    for d in range(DIM):
        v = s.row[i * ROW + V + d]
        vv += v * v
    pieces = math.sqrt(vv) * 0.5 * duration / s.number[STRETCH]
    return 1 + int(pieces) if pieces < MANY else MANY


@jit
def count_lines(s, begin, duration):
    """Count the lines of each cell; returns the number of all."""
    n = s.counter[N]
    total = 0
    for m in range(n):
        i = int(s.order[m])
        prefetch(s.row, s.order[min(m + AHEAD, n - 1)] * ROW)
        pieces = pieces_of(s, i, duration)
        s.pieces[i] = pieces
        total += pieces
        for p in range(pieces):
            cell = cell_at(s, i, begin + duration * (p + 0.5) / pieces)
            s.where[i] = cell
            s.cell_start[cell] += 1
    return total


@jit
def sort_lines(s, begin, duration):
    """Write the lines of all particles cell by cell; `cell_start` holds the end of each cell's run, and then its beginning."""
    n = s.counter[N]
    for m in range(n - 1, -1, -1):
        i = int(s.order[m])
        prefetch(s.row, s.order[max(m - AHEAD, 0)] * ROW)
        pieces = s.pieces[i]
        for p in range(pieces):
            t = begin + duration * (p + 0.5) / pieces
            cell = int(s.where[i]) if pieces == 1 else cell_at(s, i, t)
            slot = s.cell_start[cell] - 1
            s.cell_start[cell] = slot
            write_line(s, slot, i, t, s.number[MIDDLE], pieces)


@jit
def register_all(s, cells):
    """Sort the lines of all particles into contiguous runs, one for each cell; SHORT_LISTS tells if there was no room."""
    duration = 2.0 * s.number[HALF_WINDOW]
    begin = s.counter[BUCKET] // s.counter[WINDOW_BUCKETS] * duration
    s.number[MIDDLE] = begin + s.number[HALF_WINDOW]
    for cell in range(cells + 1):
        s.cell_start[cell] = 0
        s.cell_chain[cell] = -1
    total = count_lines(s, begin, duration)
    s.counter[REGISTERED] = total
    if total > s.counter[LINE_ROOM]:
        s.counter[SHORT_LISTS] = 1
        return
    running = 0
    for cell in range(cells + 1):
        running += s.cell_start[cell]
        s.cell_start[cell] = running
    sort_lines(s, begin, duration)
    s.counter[LINES] = total
    if s.counter[BUCKET] == 0:
        keep_order(s, total)


@jit
def keep_order(s, total):
    """Go through the particles in the order of their cells from now on: it saves waiting for memory, and changes nothing else."""
    m = 0
    for slot in range(total):
        i = int(s.line_ids[slot])
        if s.pieces[i] > 0:
            s.pieces[i] = 0
            s.order[m] = i
            m += 1


@jit
def open_window(s, cells):
    """Register all lines and find all candidates of the window that begins in the current bucket."""
    s.counter[CANDIDATES] = 0
    s.counter[SHORT_LISTS] = 0
    s.counter[SHORT_CELLS] = 0
    s.counter[SHORT_QUEUE] = 0
    s.counter[AGENDA_LENGTH] = 0
    for slot in range(s.counter[WINDOW_BUCKETS]):
        s.buckets[slot] = -1
    register_all(s, cells)
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
    """Find what happens to i, which has just changed, in the rest of the window, and chain its new line to its cells."""
    if WALLS:
        note_wall(s, i)
    middle, half = s.number[MIDDLE], s.number[HALF_WINDOW]
    duration = middle + half - now
    if duration <= 0.0:
        return
    since = np.float32((now - middle) / half - 1e-5)
    pieces = pieces_of(s, i, duration)
    for p in range(pieces):
        t = now + duration * (p + 0.5) / pieces
        slot = s.counter[LINES]
        if slot == s.counter[LINE_ROOM]:
            s.counter[SHORT_LISTS] = 1
            return
        s.counter[LINES] = slot + 1
        write_line(s, slot, i, t, middle, pieces)
        cell = cell_at(s, i, t)
        meet_around(s, slot, i, cell, since)
        s.line_next[slot] = s.cell_chain[cell]
        s.cell_chain[cell] = slot


@jit
def meet_cells(s, slot, i, first, last, sx, sy, sz, since):
    """Compare a new line with all lines of some cells that follow each other, and with those chained to them since."""
    room = s.counter[LINE_ROOM]
    line = line_at(s.lines, room, slot, -sx, -sy, -sz)
    meet_run(s, s.lines, s.line_ids, room, s.cell_start[first], s.cell_start[last + 1], i, line, since)
    for cell in range(first, last + 1):
        new = s.cell_chain[cell]
        while new >= 0:
            meet_line(s, s.lines, s.line_ids, room, new, i, line, since)
            new = s.line_next[new]


@jit
def meet_around(s, slot, i, cell, since):
    """Compare a new line with all lines of its cell and the cells around."""
    ny, nz = s.counter[CELLS + 1], s.counter[CELLS + 2]
    cx, cy, z = cell // nz // ny, cell // nz % ny, cell % nz
    first, last = max(z - 1, 0), min(z + 1, nz - 1)
    wraps = s.number[INVERSE + 2] > 0.0
    for kx in range(cx - 1, cx + 2):
        x, sx = around(s, kx, 0)
        for ky in range(cy - 1, cy + 2):
            y, sy = around(s, ky, 1)
            if x >= 0 and y >= 0:
                row = (x * ny + y) * nz
                meet_cells(s, slot, i, row + first, row + last, sx, sy, ZERO, since)
                if wraps and last - first < 2:
                    other, sz = around(s, z - 1 if z == 0 else z + 1, 2)
                    meet_cells(s, slot, i, row + other, row + other, sx, sy, sz, since)
