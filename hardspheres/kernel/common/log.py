"""The log of events: a buffer that Python empties when it is full.

The loop stops before an event that would find no room, and is called again once the buffer has been handed
over. Particles are logged by the lower, then the higher id, whichever of the two the event was stored with.
"""

import math

from .. import layout as at
from ..flags import DIM, GRAVITY, THREADS
from ..simd.jit import jit
from .flights import began_here, flown_for, speed_of


@jit
def log_event(s, i, j, t, impulse, path_i, path_j):
    """Write an event down but for its normal; returns where that goes."""
    row = s.counter[at.LOGGED] * at.LOG_ROW
    s.counter[at.LOGGED] += 1
    s.log[row + at.LOG_TIME] = s.counter[at.EPOCH] * s.number[at.EPOCH_LENGTH] + t
    s.log[row + at.LOG_FIRST] = i
    s.log[row + at.LOG_SECOND] = j
    s.log[row + at.LOG_IMPULSE] = impulse
    s.log[row + at.LOG_PATHS] = path_i
    s.log[row + at.LOG_PATHS + 1] = path_j
    if THREADS:
        s.log[row + at.LOG_EPOCH] = s.counter[at.EPOCH]
        s.log[row + at.LOG_MOMENT] = t
        s.log[row + at.LOG_ROUND] = s.counter[at.ROUND]
    return row + at.LOG_NORMAL


@jit
def log_pair(s, i, j, t, push, rr, x, y, z, path_i, path_j):
    """Write down a collision that gave i the momentum push (x, y, z), along a vector of squared length rr."""
    distance = math.sqrt(rr)
    normal = log_event(s, i, j, t, push * distance, path_i, path_j)
    s.log[normal] = x / distance
    s.log[normal + 1] = y / distance
    if DIM == 3:
        s.log[normal + 2] = z / distance


@jit
def log_wall(s, i, wall, t, axis, side, impulse):
    """Write down a hit of a wall; the path is that so far, as the flight goes on."""
    path = speed_of(s, i) * flown_for(s, i, t) if began_here(s, i) and not GRAVITY else math.nan
    normal = log_event(s, i, wall, t, impulse, path, math.nan)
    for d in range(DIM):
        s.log[normal + d] = 0.0
    s.log[normal + axis] = -1.0 if side else 1.0
