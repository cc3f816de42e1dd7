"""What events do to the rows: the only places where the canonical state changes.

A collision of two particles, the reflection at a wall, and the end of an epoch. Everything that is found from
a row compares the particle's version, which each event raises; so nothing else has to be told.
"""

import math

from hardspheres import collision, growth

from .. import layout as at
from ..flags import DIM, FLIGHTS, GRAVITY, GROWS, HEAT, MASSES, OBSTACLES, SIZES, THREADS
from ..simd.jit import called, jit
from ..simd.pointers import bits, from_bits
from .contact_times import full_contact, note_fall, rint, speed_at_wall
from .flights import end_flight, tally_encounter
from .log import log_pair, log_wall
from .obstacles import is_obstacle
from .tallies import (
    energy,
    tally_epoch,
    tally_fall,
    tally_heat_flux,
    tally_heat_of_wall,
    tally_heat_transfer,
    tally_obstacle,
    tally_pair,
    tally_stress,
    tally_wall,
    tally_weight,
)
from .versions import raise_version

impulse = jit(collision.impulse)
impulse_of_masses = jit(collision.impulse_of_masses)
rebound_from_wall = jit(growth.rebound_from_wall)

# dp = -2 mu (b / r.r) r holds for r of any length. With diameters of 1, 2 or 1/2, r.r itself would scatter
# round a power of two, where the spacing of doubles changes and the quotient's rounding prefers one side:
# energy would grow by 1e-17 a collision, always. Three quarters of r keeps away from there; where it does
# not, r as it is does.
THREE_QUARTERS = 0.75
AVOIDED = (
    4.0 / 3.0,
    4.0 / 3.0 * math.sqrt(2.0),
)  # of these, times powers of two, three quarters squared is 2^k
NEAR = 1e-3
FRACTION_BITS = (1 << 52) - 1  # of a float64
ONE_BITS = 0x3FF << 52


@jit
def stretch(sigma):
    """Return the factor of r for spheres with this contact distance: three quarters, or 1."""
    mantissa = from_bits((bits(sigma) & FRACTION_BITS) | ONE_BITS)
    near = (abs(mantissa - AVOIDED[0]) < NEAR) | (abs(mantissa - AVOIDED[1]) < NEAR)
    return 1.0 if near else THREE_QUARTERS


@jit
def fly(s, i, t):
    """Free flight of row i to time t."""
    if OBSTACLES and is_obstacle(s, i):
        return
    ri = i * at.ROW
    dt = t - s.row[ri + at.T]
    if GRAVITY:
        tally_fall(s, i, dt)
    for d in range(DIM):
        if GRAVITY:
            pull = s.number[at.PULL + d]
            s.row[ri + at.X + d] += (s.row[ri + at.V + d] + 0.5 * pull * dt) * dt
            s.row[ri + at.V + d] += pull * dt
        else:
            s.row[ri + at.X + d] += s.row[ri + at.V + d] * dt
    s.row[ri + at.T] = t


@jit
def collide_pair(s, i, j, t):
    """Elastic collision of i and j at time t."""
    row = s.row
    low, high = min(i, j), max(i, j)
    fly(s, i, t)
    fly(s, j, t)
    path_low, path_high = 0.0, 0.0
    if FLIGHTS:
        path_low, path_high = end_flight(s, low, t), end_flight(s, high, t)
        tally_encounter(s, low, high)
    ri, rj = i * at.ROW, j * at.ROW
    factor = stretch(full_contact(s, i, j))
    x = factor * nearest(s, 0, row[ri + at.X] - row[rj + at.X])
    y = factor * nearest(s, 1, row[ri + at.X + 1] - row[rj + at.X + 1])
    u = row[ri + at.V] - row[rj + at.V]
    v = row[ri + at.V + 1] - row[rj + at.V + 1]
    b = x * u + y * v
    rr = x * x + y * y
    z, w = 0.0, 0.0
    if DIM == 3:
        z = factor * nearest(s, 2, row[ri + at.X + 2] - row[rj + at.X + 2])
        w = row[ri + at.V + 2] - row[rj + at.V + 2]
        b += z * w
        rr += z * z
    if GROWS:
        b -= math.sqrt(rr) * (full_contact(s, i, j) * s.number[at.GROWTH])
    if MASSES:
        mi, mj = s.mass[i], s.mass[j]
        push = impulse_of_masses(b, rr, mi, mj)
        if OBSTACLES and max(mi, mj) == math.inf:  # the reduced mass is that of the other
            push = impulse(b, rr, min(mi, mj))
    else:
        mi, mj = s.number[at.MASS], s.number[at.MASS]
        push = impulse(b, rr, s.number[at.REDUCED])
    if FLIGHTS and s.counter[at.LOG_ROOM] > 0:
        sign = 1.0 if i == low else -1.0
        log_pair(s, low, high, t, push, rr, sign * x, sign * y, sign * z, path_low, path_high)
    unequal = 0.0
    if HEAT:
        unequal = energy(s, i) - energy(s, j)
        tally_heat_flux(s, i, j, -1.0, t)
    pi, pj = push / mi, push / mj
    row[ri + at.V] += pi * x
    row[rj + at.V] -= pj * x
    row[ri + at.V + 1] += pi * y
    row[rj + at.V + 1] -= pj * y
    if DIM == 3:
        row[ri + at.V + 2] += pi * z
        row[rj + at.V + 2] -= pj * z
        w += row[ri + at.V + 2] - row[rj + at.V + 2]
    if GRAVITY:
        note_fall(s, i)
        note_fall(s, j)
    u += row[ri + at.V] - row[rj + at.V]
    v += row[ri + at.V + 1] - row[rj + at.V + 1]
    tally_pair(s, push, t, x, y, z, u, v, w, 1.0 if factor == 1.0 else 1.0 / THREE_QUARTERS)
    if HEAT:
        tally_heat_flux(s, i, j, 1.0, t)
        tally_heat_transfer(s, i, j, unequal, x, y, z, 1.0 if factor == 1.0 else 1.0 / THREE_QUARTERS)
    if OBSTACLES and max(mi, mj) == math.inf:
        tally_obstacle(s, push if mi == math.inf else -push, x, y, z)
        if GRAVITY:
            note_rest(s, j if mi == math.inf else i, x, y, z, 1.0 if factor == 1.0 else 1.0 / THREE_QUARTERS)
        raise_version(s, j if mi == math.inf else i)
    else:
        raise_version(s, i)
        raise_version(s, j)
    s.counter[at.PAIRS] += 1
    s.counter[at.LAST_PAIR_EPOCH] = s.counter[at.EPOCH]


@jit
def note_rest(s, i, x, y, z, scale):
    """Note whether i has come to rest on an obstacle, scale (x, y, z) apart: bounces so low come in no end.

    With the speed v_n away from it, and r.r'' = v^2 + a.r < 0, the bounce rises by v_n^2 / (-2 r.r'') of r.
    """
    u, v = s.row[i * at.ROW + at.V], s.row[i * at.ROW + at.V + 1]
    b, rr = x * u + y * v, x * x + y * y
    bend = u * u + v * v + scale * (x * s.number[at.PULL] + y * s.number[at.PULL + 1])
    if DIM == 3:
        w = s.row[i * at.ROW + at.V + 2]
        b, rr, bend = b + z * w, rr + z * z, bend + w * w + scale * z * s.number[at.PULL + 2]
    if bend < 0.0 and 1.0 + b * b / rr / (-2.0 * bend) == 1.0:
        s.counter[at.RESTING] = i + 1


@jit
def nearest(s, d, separation):
    """Separation along axis d of the nearest images; no box is under two diameters."""
    return separation - s.number[at.BOX + d] * rint(separation * s.number[at.INVERSE + d])


@jit
def hit_wall(s, i, wall, t):
    """Specular reflection of i at a wall at time t."""
    axis = (wall - s.counter[at.N]) >> 1
    side = (wall - s.counter[at.N]) & 1
    if GRAVITY:
        fall_to_wall(s, i, axis, side, t)
    else:
        fly(s, i, t)
    ri = i * at.ROW
    mass = s.mass[i] if MASSES else s.number[at.MASS]
    radius = s.row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    v = s.row[ri + at.V + axis]
    s.row[ri + at.V + axis] = -v
    tally_wall(s, axis, side, 2.0 * mass * abs(v), radius)
    if FLIGHTS and s.counter[at.LOG_ROOM] > 0:
        log_wall(s, i, wall, t, axis, side, 2.0 * mass * abs(v))
    if GROWS:  # the sums of walls are then those of the flight alone
        outward = -1.0 if side else 1.0
        s.row[ri + at.V + axis] = outward * rebound_from_wall(-outward * v, radius * s.number[at.GROWTH])
    for d in range(DIM):
        if d != axis:
            tally_stress(s, d + axis + at.SHEAR, -2.0 * mass * v * s.row[ri + at.V + d], t)
    if HEAT:
        tally_heat_of_wall(s, i, axis, t)
    raise_version(s, i)
    s.counter[at.WALL_HITS] += 1


@jit
def fall_to_wall(s, i, axis, side, t):
    """Flight of row i to a wall: there exactly, with the speed that follows from the energy."""
    speed = speed_at_wall(s, i, axis, side)
    fly(s, i, t)
    pull = s.number[at.PULL + axis] if side else -s.number[at.PULL + axis]
    ri = i * at.ROW
    radius = s.row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    if pull != 0.0:
        s.row[ri + at.X + axis] = s.number[at.BOX + axis] - radius if side else radius
    s.row[ri + at.V + axis] = speed if side else -speed
    # Bounces so low come in no end.
    if pull > 0.0 and radius + speed * speed / (2.0 * pull) == radius:
        s.counter[at.RESTING] = i + 1


@called
def begin_epoch(s):
    """At the end of an epoch every row flies there and back into the box, and its clock goes back to zero.

    This is the one change of rows that no event makes. It happens at multiples of the epoch's length, which
    the scene and the rows decide, so the trajectory depends on neither the search for neighbours nor on who
    looks at it.
    """
    fly_to_end_of_epoch(s, 0, s.counter[at.N])
    count_epoch(s)
    if MASSES and not GROWS:
        s.number[at.MEAN_SQUARE] = mean_square(s)


@jit
def fly_to_end_of_epoch(s, first, last):
    """Let rows from first to last fly to the end of the epoch, and back into the box."""
    length = s.number[at.EPOCH_LENGTH]
    for i in range(first, last):
        if OBSTACLES and is_obstacle(s, i):
            continue
        ri = i * at.ROW
        fly(s, i, length)
        s.row[ri + at.T] = 0.0
        for d in range(DIM):
            if s.number[at.INVERSE + d] > 0.0:
                wraps = math.floor(s.row[ri + at.X + d] * s.number[at.INVERSE + d])
                shift = s.number[at.BOX + d] * wraps
                s.row[ri + at.X + d] -= shift
                s.image_counts[i * DIM + d] += int(wraps)


@jit
def count_epoch(s):
    """Begin another epoch."""
    length = s.number[at.EPOCH_LENGTH]
    if not THREADS or s.counter[at.THREAD] == 0:
        if GRAVITY:
            tally_weight(s, length)
        tally_epoch(s)
    if GROWS:
        s.number[at.SCALE] += s.number[at.GROWTH] * length
    s.counter[at.EPOCH] += 1
    s.counter[at.BUCKET] = 0
    s.number[at.NOW] -= length
    s.number[at.LAST_ADVANCE] -= length


@jit
def mean_square(s):
    """Mean square speed of those that move; equal masses keep it."""
    total = 0.0
    obstacles = 0
    for i in range(s.counter[at.N]):
        if OBSTACLES:
            obstacles += 1 if is_obstacle(s, i) else 0
        for d in range(DIM):
            v = s.row[i * at.ROW + at.V + d]
            total += v * v
    return total / (s.counter[at.N] - obstacles)


@jit
def epoch_length_due(s):
    """Whether another length of epochs is due (`hardspheres.tuning`), a longer one at every 16th only."""
    v2 = s.number[at.MEAN_SQUARE]
    return v2 >= s.number[at.UPPER_MEAN_SQUARE] or (
        v2 < s.number[at.LOWER_MEAN_SQUARE] and (s.counter[at.EPOCH] & 15) == 0
    )
