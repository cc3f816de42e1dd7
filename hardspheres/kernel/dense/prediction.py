"""The next event of a particle of the list method: a contact, a wall, or its displacement threshold.

All neighbours are solved for at once, 16 in a pass: their rows are gathered and transposed to columns, so
that the solution for each lane needs the same instructions (`contact_times`). Most lists take one pass.
"""

import math

from .. import layout as at
from ..common.contact_times import (
    LINE,
    NEVER,
    NO_PARTICLE,
    NO_TIME,
    SHIFT,
    SINCE,
    WHEN,
    discriminant_2d,
    discriminant_3d,
    growing_wall_contact,
    solve,
    solve_obstacles,
    wall_contact,
)
from ..common.obstacles import is_obstacle
from ..flags import DIM, GRAVITY, GROWS, OBSTACLES, THREADS, WALLS
from ..simd.jit import called, jit
from ..simd.pointers import from_bits, int64
from ..simd.vectors import alike, gather_transposed
from .cell_grid import fallen


@jit
def gather(s, table, i, first):
    """Copy the rows of some of i's neighbours to a table, and the images that the list stores, if any."""
    entry = i * s.counter[at.LIST_ROOM] + first
    for k in range(0, at.LANES, at.ROW):
        gather_transposed(s.scratch, table + k, at.LANES, s.row, s.neighbours, entry + k)
    if s.counter[at.IMAGES]:
        for k in range(at.LANES):
            for d in range(DIM):
                s.scratch[table + SHIFT + d * at.LANES + k] = s.images[(entry + k) * DIM + d]


@jit
def changed_since(s, table, now):
    """How many in a table have rows from now or later; several threads need not come to events in order."""
    changed = 0
    for k in range(at.LANES):
        changed += 1 if s.scratch[table + SINCE + k] >= now else 0
    return changed


@jit
def soonest_contact(s, table, i, first, now):
    """Solve for those in a table, from slot `first` of i's list on; return the soonest as `solve` does."""
    soonest = solve(s, table, i, now, at.LANES)
    if THREADS:
        s.counter[at.CHANGED_SINCE] += changed_since(s, table, now)
    if GRAVITY and OBSTACLES:
        soonest = solve_obstacles(s, table, i, now, i * s.counter[at.LIST_ROOM] + first)
    return soonest


@jit
def earliest_in_table(s, table, entry, soonest):
    """Bits of the earliest time in a table, and whose it is; equal times: the lower partner.

    `soonest` is from `solve`: a time without its lowest bits, and its line. Where others have the same time
    without these bits, all bits decide.
    """
    same = alike(s.scratch_int, table + WHEN, soonest, LINE)
    if same & (same - 1):
        return earliest_of_several(s, table, entry, same)
    line = soonest & LINE
    return s.scratch_int[table + WHEN + line], int64(s.neighbours[entry + line])


@called
def earliest_of_several(s, table, entry, lines):
    """As `earliest_in_table`, of those lines that have a bit in `lines`; this is rare."""
    time, partner = NO_TIME, NO_PARTICLE
    k = 0
    while lines >> k:
        when, who = s.scratch_int[table + WHEN + k], int64(s.neighbours[entry + k])
        if (lines >> k) & 1 and (when < time or (when == time and who < partner)):
            time, partner = when, who
        k += 1
    return time, partner


@jit
def ends(s, i, first):
    """Whether i's list ends before slot `first`: then the null particle is in the slot before."""
    room = s.counter[at.LIST_ROOM]
    return first == room or s.neighbours[i * room + first - 1] == s.counter[at.N]


@jit
def earliest_contact(s, table, i, soonest, now):
    """Time and partner of i's earliest contact with a neighbour, given that of the first in its list."""
    time, partner = earliest_in_table(s, table, i * s.counter[at.LIST_ROOM], soonest)
    if not ends(s, i, at.LANES):
        time, partner = earliest_of_rest(s, i, time, partner, now)
    return from_bits(time), partner


@called
def earliest_of_rest(s, i, best, partner, now):
    """Earliest contact of the best so far and of those later in i's list; times compare as their bits do."""
    first = at.LANES
    while not ends(s, i, first):
        gather(s, 0, i, first)
        entry = i * s.counter[at.LIST_ROOM] + first
        time, who = earliest_in_table(s, 0, entry, soonest_contact(s, 0, i, first, now))
        if time < best or (time == best and who < partner):
            best, partner = time, who
        first += at.LANES
    return best, partner


@jit
def threshold_crossing(s, i, now):
    """Time at which i is one displacement threshold away from its reference position.

    The row may have been written many thresholds away from there. So, as for contacts, the discriminant is
    the one in which nothing of the size of that distance cancels.
    """
    if GRAVITY and OBSTACLES:
        return curved_crossing(s, i, now)
    row = s.row
    ri, reference = i * at.ROW, i * at.EVENT + at.REFERENCE
    x, y = row[ri + at.X] - s.event_float[reference], row[ri + at.X + 1] - s.event_float[reference + 1]
    u, v = row[ri + at.V], row[ri + at.V + 1]
    if GRAVITY:
        t = row[ri + at.T]
        x, u = fallen(s, 0, x, u, t)
        y, v = fallen(s, 1, y, v, t)
    threshold2 = s.number[at.DISPLACEMENT_THRESHOLD] * s.number[at.DISPLACEMENT_THRESHOLD]
    if DIM == 3:
        z, w = row[ri + at.X + 2] - s.event_float[reference + 2], row[ri + at.V + 2]
        if GRAVITY:
            z, w = fallen(s, 2, z, w, t)
        b, vv, rr = x * u + y * v + z * w, u * u + v * v + w * w, x * x + y * y + z * z
        d = discriminant_3d(x, y, z, u, v, w, threshold2)
    else:
        b, vv, rr = x * u + y * v, u * u + v * v, x * x + y * y
        d = discriminant_2d(x, y, u, v, threshold2)
    root = math.sqrt(max(d, 0.0))
    # The positive root, in that of its two forms in which nothing cancels.
    outwards = b > 0.0
    time = (threshold2 - rr if outwards else root - b) / (b + root if outwards else vv)
    return row[ri + at.T] + time if vv > 0.0 else NEVER


@jit
def curved_crossing(s, i, now):
    """As `threshold_crossing` for a path that is curved: not later than that.

    A ball falls by a t^2 / 2 below its straight path. So it stays within the threshold as long as v t + a t^2
    / 2 does not fill the gap, and as long as the straight path stays within the threshold less the fall up to
    when it is beyond that.
    """
    if is_obstacle(s, i):
        return NEVER
    ri, reference = i * at.ROW, i * at.EVENT + at.REFERENCE
    dt = now - s.row[ri + at.T]
    rr, b, vv, aa = 0.0, 0.0, 0.0, 0.0
    for d in range(DIM):
        pull, v = s.number[at.PULL + d], s.row[ri + at.V + d]
        x = s.row[ri + at.X + d] + (v + 0.5 * pull * dt) * dt - s.event_float[reference + d]
        v += pull * dt
        rr, b, vv, aa = rr + x * x, b + x * v, vv + v * v, aa + pull * pull
    threshold, pull = s.number[at.DISPLACEMENT_THRESHOLD], math.sqrt(aa)
    gap = max(threshold - math.sqrt(rr), 0.0)
    speed = math.sqrt(vv)
    time = 2.0 * gap / (speed + math.sqrt(vv + 2.0 * pull * gap)) if gap > 0.0 else 0.0
    if vv > 0.0:
        straight = (math.sqrt(max(b * b + vv * (threshold * threshold - rr), 0.0)) - b) / vv
        rest = threshold - 0.5 * pull * straight * straight
        if rest > 0.0 and rest * rest > rr:
            time = max(time, (math.sqrt(b * b + vv * (rest * rest - rr)) - b) / vv)
    return now + time


@jit
def next_event(s, table, i, soonest, now):
    """Time and partner of i's next event: a contact, a wall, or a new neighbour list."""
    time, partner = earliest_contact(s, table, i, soonest, now)
    if WALLS:
        t, wall = growing_wall_contact(s, i) if GROWS else wall_contact(s, i)
        if t < time:
            time, partner = t, wall
    t = threshold_crossing(s, i, now)
    if t <= time:
        if t == NEVER:
            return NEVER, at.NOTHING
        return max(t, now), at.REBUILD
    return time, partner
