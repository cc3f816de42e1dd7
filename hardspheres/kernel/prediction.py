"""When does a particle meet its next partner? All neighbours at once, without branches."""

import math

from hardspheres import collision, growth

from .compiler import inline, jit
from .flags import DIM, GROWS, SIZES, WALLS
from .layout import (
    BLOCK,
    BOX,
    CENTRE,
    CORE,
    EVENT,
    GROWTH,
    IMAGES,
    INVERSE,
    LIST_ROOM,
    NOTHING,
    RADIUS,
    RENEW,
    ROW,
    SCALE,
    SHELL,
    SIGMA2,
    N,
    T,
    V,
    X,
)

contact_time = jit(collision.contact_time)
discriminant_2d = jit(collision.discriminant_2d)
discriminant_3d = jit(collision.discriminant_3d)
growing_contact_time = jit(growth.growing_contact_time)
growing_discriminant = jit(growth.growing_discriminant)

NEVER = math.inf
NO_TIME = 0x7FF0000000000000  # the bits of infinity: non-negative times order as their bits do
NO_PARTICLE = 0x7FFFFFFF

# Columns of the scratch table: separation, relative velocity, time since the separation, its time, contact, result.
SEP = 0
VEL = 3 * BLOCK
AGO = 6 * BLOCK
LATER = 7 * BLOCK
CONTACT2 = 8 * BLOCK
WHEN = 9 * BLOCK
PICK = 10 * BLOCK
FULL = 11 * BLOCK  # contact distance where the scale is 1


@jit
def lay_out(s, k, i, j, now):
    """Separation and relative velocity of i and j, both flown to the later of their local times, in line k of the table."""
    row, scratch = s.row, s.scratch
    ri = i * ROW
    rj = j * ROW
    ti = row[ri + T]
    tj = row[rj + T]
    later = max(ti, tj)
    dti = later - ti
    dtj = later - tj
    for d in range(DIM):
        sep = (row[ri + X + d] + row[ri + V + d] * dti) - (row[rj + X + d] + row[rj + V + d] * dtj)
        scratch[SEP + d * BLOCK + k] = sep
        scratch[VEL + d * BLOCK + k] = row[ri + V + d] - row[rj + V + d]
    scratch[AGO + k] = now - later
    scratch[LATER + k] = later
    if SIZES:
        sigma = row[ri + RADIUS] + row[rj + RADIUS]
        scratch[CONTACT2 + k] = sigma * sigma
    if GROWS:
        scratch[FULL + k] = full_contact(s, i, j)
    s.scratch_int[PICK + k] = j


@jit
def gather(s, i, now, first, m):
    """Lay out i and m of its neighbours, in the images that the list names, if it does."""
    entry = i * s.counter[LIST_ROOM] + 1 + first
    for k in range(m):
        lay_out(s, k, i, s.neighbours[entry + k], now)
    if s.counter[IMAGES]:
        for k in range(m):
            for d in range(DIM):
                s.scratch[SEP + d * BLOCK + k] -= s.images[(entry + k) * DIM + d] * s.number[BOX + d]


@jit
def solve(s, m):
    """Contact time of each pair that `gather` laid out; the loop is vectorised.

    The periodic image is the nearest one at the time given to `lay_out`; the separation is then taken at the later local time, so that the result
    depends on nothing but the two rows and the image. Where lists name the image, and on wall axes, INVERSE is 0 here.
    """
    scratch = s.scratch
    lx, ly, lz = s.number[BOX], s.number[BOX + 1], s.number[BOX + 2]
    ix, iy, iz = s.number[INVERSE], s.number[INVERSE + 1], s.number[INVERSE + 2]
    if s.counter[IMAGES]:
        ix, iy, iz = 0.0, 0.0, 0.0
    common = s.number[SIGMA2]
    scale, rate = s.number[SCALE], s.number[GROWTH]
    for k in range(m):
        ago = scratch[AGO + k]
        x, u = scratch[SEP + k], scratch[VEL + k]
        y, v = scratch[SEP + BLOCK + k], scratch[VEL + BLOCK + k]
        x -= lx * rint((x + u * ago) * ix)
        y -= ly * rint((y + v * ago) * iy)
        z, w = 0.0, 0.0
        sigma2 = scratch[CONTACT2 + k] if SIZES else common
        if DIM == 3:
            z, w = scratch[SEP + 2 * BLOCK + k], scratch[VEL + 2 * BLOCK + k]
            z -= lz * rint((z + w * ago) * iz)
            b = x * u + y * v + z * w
            rr = x * x + y * y + z * z
            d = discriminant_3d(x, y, z, u, v, w, sigma2)
        else:
            b = x * u + y * v
            rr = x * x + y * y
            d = discriminant_2d(x, y, u, v, sigma2)
        root = math.sqrt(max(d, 0.0))
        contact = contact_time(b, rr - sigma2, root)
        if GROWS:
            full = scratch[FULL + k]
            sigma = full * (scale + rate * scratch[LATER + k])
            contact = growing_contact(x, y, z, u, v, w, sigma, full * rate)
        scratch[WHEN + k] = scratch[LATER + k] + contact


@inline  # so that the loop can be vectorised
def growing_contact(x, y, z, u, v, w, sigma, g):
    """Time until two spheres touch whose contact distance is sigma now and grows at the rate g."""
    a = u * u + v * v + w * w - g * g
    b = x * u + y * v + z * w - sigma * g
    c = x * x + y * y + z * z - sigma * sigma
    root = math.sqrt(max(growing_discriminant(x, y, z, u, v, w, sigma, g), 0.0))
    return growing_contact_time(a, b, c, root)


@jit
def full_contact(s, i, j):
    """Contact distance of i and j where the scale is 1."""
    if SIZES:
        return s.row[i * ROW + RADIUS] + s.row[j * ROW + RADIUS]
    return 2.0 * s.number[CORE]


@jit
def rint(x):
    """Nearest integer (ties to even) of |x| < 2^51, by an addition that leaves no room for the fraction."""
    return (x + 6755399441055744.0) - 6755399441055744.0


@jit
def earliest_contact(s, i, now):
    """Time and partner of i's earliest contact with a neighbour; equal times: the lower partner."""
    total = s.neighbours[i * s.counter[LIST_ROOM]]
    best = NO_TIME
    partner = NO_PARTICLE
    time = NEVER
    for first in range(0, total, BLOCK):
        m = min(total - first, BLOCK)
        gather(s, i, now, first, m)
        solve(s, m)
        soonest = NO_TIME
        for k in range(m):
            soonest = min(soonest, s.scratch_int[WHEN + k])
        if soonest < best or (soonest == best and soonest < NO_TIME):
            if soonest < best:
                partner = NO_PARTICLE
            best = soonest
            for k in range(m):
                pick = s.scratch_int[PICK + k] if s.scratch_int[WHEN + k] == soonest else NO_PARTICLE
                partner = min(partner, pick)
                time = s.scratch[WHEN + k] if s.scratch_int[WHEN + k] == soonest else time
    return time, partner


@jit
def wall_contact(s, i):
    """Time and wall (n + 2 axis + side) of i's next wall; never, where no wall lies ahead."""
    row = s.row
    ri = i * ROW
    time = NEVER
    wall = NOTHING
    radius = row[ri + RADIUS] if SIZES else s.number[CORE]
    for d in range(DIM):
        v = row[ri + V + d]
        if s.number[INVERSE + d] == 0.0 and v != 0.0:
            side = 1 if v > 0.0 else 0
            gap = (s.number[BOX + d] - radius) - row[ri + X + d] if v > 0.0 else row[ri + X + d] - radius
            t = row[ri + T] + max(gap, 0.0) / abs(v)
            if t < time:
                time = t
                wall = s.counter[N] + 2 * d + side
    return time, wall


@jit
def growing_wall_contact(s, i):
    """As `wall_contact` for a sphere that grows: it may meet the wall that it flies away from."""
    ri = i * ROW
    time = NEVER
    wall = NOTHING
    full = s.row[ri + RADIUS] if SIZES else s.number[CORE]
    radius = full * (s.number[SCALE] + s.number[GROWTH] * s.row[ri + T])
    for d in range(DIM):
        if s.number[INVERSE + d] == 0.0:
            x, v = s.row[ri + X + d], s.row[ri + V + d]
            for side in range(2):
                approach = full * s.number[GROWTH] + (v if side else -v)
                gap = (s.number[BOX + d] - radius) - x if side else x - radius
                if approach > 0.0:
                    t = s.row[ri + T] + max(gap, 0.0) / approach
                    if t < time:
                        time = t
                        wall = s.counter[N] + 2 * d + side
    return time, wall


@jit
def shell_exit(s, i):
    """Time at which i comes out of the shell around the centre of its neighbour list."""
    row = s.row
    ri = i * ROW
    uu = 0.0
    uv = 0.0
    vv = 0.0
    for d in range(DIM):
        u = row[ri + X + d] - s.event_float[i * EVENT + CENTRE + d]
        v = row[ri + V + d]
        uu += u * u
        uv += u * v
        vv += v * v
    if vv == 0.0:
        return NEVER
    left = (
        s.number[SHELL] * s.number[SHELL] - uu
    )  # negative where the row was written before i came into this shell
    root = math.sqrt(max(uv * uv + vv * left, 0.0))
    if uv > 0.0:
        return row[ri + T] + left / (uv + root)
    return row[ri + T] + (root - uv) / vv


@jit
def pair_contact(s, i, j, about):
    """Time of contact of one pair, in the image that is the nearest at about that time."""
    lay_out(s, 0, i, j, about)
    solve(s, 1)
    return s.scratch[WHEN]


@jit
def next_event(s, i, now):
    """Time and partner of the next thing that happens to i: a contact, a wall, or a new neighbour list."""
    time, partner = earliest_contact(s, i, now)
    if WALLS:
        t, wall = growing_wall_contact(s, i) if GROWS else wall_contact(s, i)
        if t < time:
            time, partner = t, wall
    t = shell_exit(s, i)
    if t <= time:
        if t == NEVER:
            return NEVER, NOTHING
        return max(t, now), RENEW
    return time, partner
