"""What each free flight adds to the sums when it ends.

A flight lasts from one collision of two particles to the next.
Walls turn a flight round and do not end it: the speed, and so path = speed x time, goes on. Nothing here is
read by the dynamics.
"""

import math

from .. import layout as at
from ..flags import DIM, GRAVITY, MASSES, OBSTACLES, SIZES
from ..simd.jit import jit
from ..simd.pointers import bits
from ..simd.vectors import add_terms
from .obstacles import is_obstacle

BELOW = (
    (1023 + at.LEAST_OCTAVE) << at.OCTAVE_BITS
) - 1  # leading bits of the largest number in the first bin


@jit
def species_of(s, i):
    """Species of i."""
    return int(s.flight[i * at.FLIGHT + at.SPECIES]) if SIZES or MASSES else 0


@jit
def speed_of(s, i):
    """Speed of i."""
    vv = s.row[i * at.ROW + at.V] * s.row[i * at.ROW + at.V]
    for d in range(1, DIM):
        vv += s.row[i * at.ROW + at.V + d] * s.row[i * at.ROW + at.V + d]
    return math.sqrt(vv)


@jit
def flown_for(s, i, t):
    """How long i has been flying at time t; from the start of the simulation if it has not collided yet."""
    epochs = s.counter[at.EPOCH] - s.flight[i * at.FLIGHT + at.BEGAN_EPOCH]
    return epochs * s.number[at.EPOCH_LENGTH] + (t - s.flight[i * at.FLIGHT + at.BEGAN])


@jit
def began_here(s, i):
    """Whether the beginning of i's flight is known."""
    return s.flight[i * at.FLIGHT + at.BEGAN_EPOCH] >= 0.0


@jit
def octave_bin(x):
    """Bin of a path or time in its unit: the leading bits of a double are a piecewise linear logarithm."""
    return max(0, min((bits(x) >> (52 - at.OCTAVE_BITS)) - BELOW, at.FLIGHT_BINS - 1))


@jit
def end_flight(s, i, t):
    """Tally the flight of i that a collision at time t ends, and begin the next; returns its path or NaN."""
    if OBSTACLES and is_obstacle(s, i):
        return math.nan
    time, speed = flown_for(s, i, t), speed_of(s, i)
    path = speed * time
    known = began_here(s, i)
    s.flight[i * at.FLIGHT + at.BEGAN] = t
    s.flight[i * at.FLIGHT + at.BEGAN_EPOCH] = s.counter[at.EPOCH]
    if GRAVITY:  # the path is no straight line, and not told
        return math.nan
    species = species_of(s, i)
    sums = at.FLIGHT_SUMS + species * 2 * at.FLIGHT_SUM
    counts = at.FLIGHT_COUNTS + species * at.FLIGHT_COUNT
    units = at.FLIGHT_UNITS + at.FLIGHT_UNIT * species
    p, q = path * s.number[units + at.PER_PATH], time * s.number[units + at.PER_TIME]
    first, square, cube = at.PER_MOMENT
    if not known:
        add_terms(s.total, sums + at.FIRST_PATH, at.FLIGHT_SUM, (first * p,))
        s.counter[counts + at.FIRST_FLIGHTS] += 1
        return math.nan
    s.counter[counts + at.FLIGHTS_ENDED] += 1
    terms = (square * (p * p), cube * (p * p * p), square * (q * q), cube * (q * q * q))
    add_terms(s.total, sums + at.HIGHER_MOMENTS, at.FLIGHT_SUM, terms)
    s.counter[counts + at.PATH_BINS + octave_bin(path * s.number[units])] += 1
    s.counter[counts + at.TIME_BINS + octave_bin(time * s.number[units + 1])] += 1
    k = int(min(speed * s.number[units + 2], at.SPEED_BINS - 1.0))
    s.counter[counts + at.SPEED_COUNTS + k] += 1
    add_terms(s.total, sums + at.SPEED_FLIGHTS + 2 * k, at.FLIGHT_SUM, (first * p, first * q))
    return path


@jit
def tally_encounter(s, i, j):
    """Count a collision between the species of i and j."""
    species_count = s.counter[at.SPECIES_COUNT]
    s.counter[
        at.FLIGHT_COUNTS
        + species_count * at.FLIGHT_COUNT
        + species_of(s, i) * species_count
        + species_of(s, j)
    ] += 1
