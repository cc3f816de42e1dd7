"""What the events of a bucket will read in windows, fetched ahead where a gas is larger than all caches.

A search reads where a particle's line is, in which cell, where the lines near it begin, and these: each from a place that the one
before tells, and each would be waited for. Here every step is made for all events of the bucket before the next one.
"""

from .compiler import AT_ONCE, jit, part, prefetch
from .layout import AGENDA_LENGTH, CELLS, STAMP_BITS, N
from .line_cells import cell_place, columns_around
from .lines import LINE, NEAR_SHIFT


@part
def fetch_surroundings(s):
    """Have in the cache what the searches after the events on the agenda will read."""
    for a in range(s.counter[AGENDA_LENGTH]):
        first, second = partners_on_agenda(s, a)
        prefetch(s.where, first)
        prefetch(s.where, second)
    for a in range(s.counter[AGENDA_LENGTH]):
        first, second = partners_on_agenda(s, a)
        fetch_line(s, first)
        fetch_line(s, second)
    for a in range(s.counter[AGENDA_LENGTH]):
        fetch_columns(s, partners_on_agenda(s, a)[0], False)
    for a in range(s.counter[AGENDA_LENGTH]):
        fetch_columns(s, partners_on_agenda(s, a)[0], True)


@jit
def partners_on_agenda(s, a):
    """Lower and higher id of an entry; twice the same where the partner is a wall."""
    low, high = s.agenda_key[a] >> 32, s.agenda_key[a] & STAMP_BITS
    return low, high if high < s.counter[N] else low


@jit
def fetch_line(s, i):
    """Fetch i's line, its bounds and its cell."""
    slot = s.where[i]
    if slot >= 0:
        prefetch(s.lines, slot * LINE)
        prefetch(s.bounds, slot)
        prefetch(s.cell_of_line, slot)


@jit
def fetch_columns(s, i, lines):
    """Fetch where the lines of the columns near i's line begin, or the bounds that stand there; its partner's are the same."""
    slot = s.where[i]
    if slot < 0:
        return
    x, y, z = cell_place(s, int(s.cell_of_line[slot]))
    for k in range(columns_around(s, 0, s.bounds[slot] >> NEAR_SHIFT, x, z)):
        cell = int(s.column[s.places[k]]) * s.counter[CELLS + 1] + max(y - 1, 0)
        if lines:
            prefetch(s.bounds, s.cell_count[cell])
            prefetch(s.bounds, s.cell_count[cell] + AT_ONCE // 2)
        else:
            prefetch(s.cell_count, cell)
