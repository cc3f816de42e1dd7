"""How the box is divided among threads, and who may take part in an event of a round.

Tiles are blocks of whole columns of cells. A domain is a tile where an axis is not divided, or two of them
next to each other along each axis that is; in another shift each tile goes with its other neighbour. A
particle is inside its domain if its column is not in the domain's first or last layer of columns: then all on
its list, and all cells that its list is made from, belong to the domain. So events of particles inside need
to know of no other thread. Every column is inside a domain in one of the shifts.

An event whose particle is not inside, or waits for one that was put off, is put off to a later round: its
particles are frozen for the rest of this one.
"""

from .. import layout as at
from ..simd.jit import jit

BITS_OF_SHIFTS = 0xFF
TILE = 8  # where the tile stands in `place`
TILES = 0xFFFF
FROZEN = 24  # where the round stands


@jit
def settle(s, i, column):
    """Note in which tile i is, from the column of its reference position."""
    round_of_freezing = s.place[i] >> FROZEN << FROZEN
    s.place[i] = round_of_freezing | int(s.tile_of_column[column]) << TILE | int(s.inside_in[column])


@jit
def tile_of(s, i):
    """Tile of i."""
    return (s.place[i] >> TILE) & TILES


@jit
def is_inside(s, column):
    """Whether a column is inside its domain, in this shift."""
    return (int(s.inside_in[column]) >> s.counter[at.SHIFT]) & 1 == 1


@jit
def free_to_go(s, i):
    """Whether i is inside its domain and not frozen in this round."""
    place = s.place[i]
    return (place >> s.counter[at.SHIFT]) & 1 == 1 and place >> FROZEN != s.counter[at.ROUND]


@jit
def freeze(s, i):
    """Freeze i for the rest of the round."""
    s.place[i] = s.place[i] & ((1 << FROZEN) - 1) | s.counter[at.ROUND] << FROZEN


@jit
def is_ours(s, i):
    """Whether i is in the domain at work."""
    return s.domain_of[s.counter[at.SHIFT] * s.counter[at.TILES] + tile_of(s, i)] == s.counter[at.DOMAIN]


@jit
def put_off(s, i):
    """Put i's event off to a later round."""
    freeze(s, i)
    k = s.counter[at.PUT_OFF]
    if k == s.counter[at.HEAP_ROOM]:
        s.counter[at.SHORT_QUEUE] = 1
        return
    s.counter[at.PUT_OFF] = k + 1
    s.put_off[k] = i


@jit
def owner(s, tile):
    """Thread that clears and fills the tables of a tile."""
    return tile * s.counter[at.THREAD_COUNT] // s.counter[at.TILES]
