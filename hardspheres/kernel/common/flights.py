"""What each free flight adds to the sums when it ends.

A flight lasts from one collision of two particles to the next.
Walls turn a flight round and do not end it: the speed, and so path = speed x time, goes on. Nothing here is
read by the dynamics.
"""

import math

from ..flags import DIM, MASSES, SIZES
from ..layout import (
    BEGAN,
    BEGAN_EPOCH,
    EPOCH,
    EPOCH_LENGTH,
    FIRST_FLIGHTS,
    FIRST_PATH,
    FLIGHT,
    FLIGHT_BINS,
    FLIGHT_COUNT,
    FLIGHT_COUNTS,
    FLIGHT_SUM,
    FLIGHT_SUMS,
    FLIGHT_UNITS,
    FLIGHTS_ENDED,
    LEAST_OCTAVE,
    OCTAVE_BITS,
    PATH_BINS,
    PATHS,
    ROW,
    SPECIES,
    SPECIES_COUNT,
    SPEED_BINS,
    SPEED_COUNTS,
    SPEED_PATHS,
    SPEED_TIMES,
    TIME_BINS,
    TIMES,
    V,
)
from ..simd.jit import jit
from ..simd.pointers import bits

BELOW = ((1023 + LEAST_OCTAVE) << OCTAVE_BITS) - 1  # leading bits of the largest number in the first bin


@jit
def species_of(s, i):
    """Species of i."""
    return int(s.flight[i * FLIGHT + SPECIES]) if SIZES or MASSES else 0


@jit
def speed_of(s, i):
    """Speed of i."""
    vv = s.row[i * ROW + V] * s.row[i * ROW + V]
    for d in range(1, DIM):
        vv += s.row[i * ROW + V + d] * s.row[i * ROW + V + d]
    return math.sqrt(vv)


@jit
def flown_for(s, i, t):
    """How long i has been flying at time t; from the start of the simulation if it has not collided yet."""
    epochs = s.counter[EPOCH] - s.flight[i * FLIGHT + BEGAN_EPOCH]
    return epochs * s.number[EPOCH_LENGTH] + (t - s.flight[i * FLIGHT + BEGAN])


@jit
def began_here(s, i):
    """Whether the beginning of i's flight is known."""
    return s.flight[i * FLIGHT + BEGAN_EPOCH] >= 0.0


@jit
def octave_bin(x):
    """Bin of a path or time in its unit: the leading bits of a double are a piecewise linear logarithm."""
    return max(0, min((bits(x) >> (52 - OCTAVE_BITS)) - BELOW, FLIGHT_BINS - 1))


@jit
def end_flight(s, i, t):
    """Tally the flight of i that a collision at time t ends, and begin the next; returns its path or NaN."""
    time, speed = flown_for(s, i, t), speed_of(s, i)
    path = speed * time
    known = began_here(s, i)
    s.flight[i * FLIGHT + BEGAN] = t
    s.flight[i * FLIGHT + BEGAN_EPOCH] = s.counter[EPOCH]
    species = species_of(s, i)
    sums = FLIGHT_SUMS + species * FLIGHT_SUM
    counts = FLIGHT_COUNTS + species * FLIGHT_COUNT
    if not known:
        s.total[sums + FIRST_PATH] += path
        s.counter[counts + FIRST_FLIGHTS] += 1
        return math.nan
    s.counter[counts + FLIGHTS_ENDED] += 1
    s.total[sums + PATHS] += path
    s.total[sums + PATHS + 1] += path * path
    s.total[sums + PATHS + 2] += path * path * path
    s.total[sums + TIMES] += time
    s.total[sums + TIMES + 1] += time * time
    s.total[sums + TIMES + 2] += time * time * time
    units = FLIGHT_UNITS + 3 * species
    s.counter[counts + PATH_BINS + octave_bin(path * s.number[units])] += 1
    s.counter[counts + TIME_BINS + octave_bin(time * s.number[units + 1])] += 1
    k = int(min(speed * s.number[units + 2], SPEED_BINS - 1.0))
    s.counter[counts + SPEED_COUNTS + k] += 1
    s.total[sums + SPEED_PATHS + k] += path
    s.total[sums + SPEED_TIMES + k] += time
    return path


@jit
def tally_encounter(s, i, j):
    """Count a collision between the species of i and j."""
    species_count = s.counter[SPECIES_COUNT]
    s.counter[
        FLIGHT_COUNTS + species_count * FLIGHT_COUNT + species_of(s, i) * species_count + species_of(s, j)
    ] += 1
