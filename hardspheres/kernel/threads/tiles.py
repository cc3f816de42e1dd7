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
from ..flags import SPARSE
from ..simd.jit import jit
from .homes import home_of

# A particle's TILE_WORD: the shifts in which it is inside its domain, a bit each; whether it has come from
# another tile; the tile; the round in which it is frozen.
HAS_MOVED = 1 << 7
FROZEN = 24


@jit
def word_of(s, i):
    """TILE_WORD of i."""
    if SPARSE:
        return s.home[home_of(s, i)]
    return s.event[i * at.EVENT + at.TILE_WORD]


@jit
def settle(s, i, column):
    """Note in which tile i is, from the column of its reference position, and whether it has moved there."""
    before, tile = word_of(s, i), int(s.tile_of_column[column])
    moved = HAS_MOVED if (before >> at.TILE_SHIFT) & at.TILE_BITS != tile else before & HAS_MOVED
    s.event[i * at.EVENT + at.TILE_WORD] = (
        before >> FROZEN << FROZEN | tile << at.TILE_SHIFT | moved | int(s.inside_in[column])
    )


@jit
def has_moved(s, i):
    """Whether i has come from another tile since this was asked last."""
    word = word_of(s, i)
    s.event[i * at.EVENT + at.TILE_WORD] = word & ~HAS_MOVED
    return word & HAS_MOVED > 0


@jit
def tile_of(s, i):
    """Tile of i."""
    return (word_of(s, i) >> at.TILE_SHIFT) & at.TILE_BITS


@jit
def is_inside(s, column):
    """Whether a column is inside its domain, in this shift."""
    return (int(s.inside_in[column]) >> s.counter[at.SHIFT]) & 1 == 1


@jit
def is_inside_now(s, i):
    """Whether i is inside its domain, in this shift."""
    return (word_of(s, i) >> s.counter[at.SHIFT]) & 1 == 1


@jit
def free_to_go(s, i):
    """Whether i is inside its domain and not frozen in this round."""
    word = word_of(s, i)
    return (word >> s.counter[at.SHIFT]) & 1 == 1 and word >> FROZEN != s.counter[at.ROUND]


@jit
def freeze(s, i):
    """Freeze i for the rest of the round."""
    word = word_of(s, i) & ((1 << FROZEN) - 1) | s.counter[at.ROUND] << FROZEN
    if SPARSE:
        s.home[home_of(s, i)] = word
    else:
        s.event[i * at.EVENT + at.TILE_WORD] = word


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
