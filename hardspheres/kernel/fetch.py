"""What the events of a bucket will read in windows, fetched ahead where a gas is larger than all caches.

A search reads where a particle's line is, in which cell, where the lines near it begin, and these: each from a place that the one
before tells, and each would be waited for. Here every step is made for all events of the bucket before the next one.
"""

from .compiler import AT_ONCE, jit, part, prefetch, whole
from .layout import AGENDA_LENGTH, CELLS, STAMP_BITS, N
from .line_cells import cell_place, columns_around
from .lines import LINE, NEAR_SHIFT

# The steps: where the line is, the line itself, where the lines of near columns begin, and their bounds.
STEPS = 4
ITSELF, COLUMNS = 1, 2


@part
def fetch_surroundings(s):
    """Have in the cache what the searches after the events on the agenda will read.

    The columns near both partners are the same, nearly: they are fetched once.
    """
    for step in range(STEPS):
        ids = 2 if step < COLUMNS else 1
        for a in range(ids * s.counter[AGENDA_LENGTH]):
            key = s.agenda_key[a // ids]
            i = key >> 32 if a % ids == 0 else key & STAMP_BITS
            if i < s.counter[N]:  # no wall
                fetch_step(s, step, i)


@jit
def fetch_step(s, step, i):
    """Fetch what one step reads of i."""
    if step == 0:
        prefetch(s.where, i)
        return
    slot = s.where[i]
    if slot < 0:
        return
    if step == ITSELF:
        prefetch(s.lines, slot * LINE)
        prefetch(s.bounds, slot)
        prefetch(s.cell_of_line, slot)
        return
    x, y, z = cell_place(s, whole(s.cell_of_line[slot]))
    for k in range(columns_around(s, whole(0), s.bounds[slot] >> NEAR_SHIFT, x, z)):
        cell = whole(s.column[s.places[k]]) * s.counter[CELLS + 1] + max(y - 1, 0)
        if step == COLUMNS:
            prefetch(s.cell_count, cell)
        else:
            prefetch(s.bounds, s.cell_count[cell])
            prefetch(s.bounds, s.cell_count[cell] + AT_ONCE // 2)
