"""Contact times: a pure function of two rows and the periodic image; many pairs at once, without branches.

One particle is compared with a table of partners, column by column: their rows as they are, gathered by the
caller. Every partner gets a time, infinite where there is no contact, since a branch would keep the compiler
from using vectors. Formulas and their sources: `hardspheres.collision`, for spheres that grow
`hardspheres.growth`.
"""

import math

from hardspheres import collision, falling, gravity, growth

from .. import layout as at
from ..flags import DIM, GRAVITY, GROWS, SIZES
from ..simd.jit import jit
from ..simd.pointers import bits
from .obstacles import is_obstacle

contact_time = jit(collision.contact_time)
discriminant_2d = jit(collision.discriminant_2d)
discriminant_3d = jit(collision.discriminant_3d)
growing_contact_time = jit(growth.growing_contact_time)
growing_discriminant = jit(growth.growing_discriminant)
impact_time = jit(gravity.impact_time)
impact_square = jit(gravity.impact_square)
climbed_speed = jit(gravity.climbed_speed)
falling_contact_time = jit(falling.falling_contact_time)

NEVER = math.inf
NO_TIME = 0x7FF0000000000000  # the bits of infinity: non-negative times order as their bits do
NO_PARTICLE = 0x7FFFFFFF
LINE = at.LANES - 1  # lowest bits of a time, in place of which `solve` puts the line of the table

# Columns of a table of partners: their rows as they are, and the contact times found. There are two tables.
PLACE = at.X * at.LANES
VEL = at.V * at.LANES
SINCE = at.T * at.LANES
SIZE = at.RADIUS * at.LANES
WHEN = at.ROW * at.LANES
SHIFT = 9 * at.LANES
TABLE = 16 * at.LANES  # where the second one begins


@jit
def copy_row(s, k, j):
    """Copy the row of j to line k of the table."""
    rj = j * at.ROW
    for d in range(DIM):
        s.scratch[PLACE + d * at.LANES + k] = s.row[rj + at.X + d]
        s.scratch[VEL + d * at.LANES + k] = s.row[rj + at.V + d]
    s.scratch[SINCE + k] = s.row[rj + at.T]
    if SIZES:
        s.scratch[SIZE + k] = s.row[rj + at.RADIUS]


@jit
def solve(s, table, i, now, m):
    """Contact time of i with each line of a table, and the soonest; the loop is vectorised.

    The soonest is the bits of a time with the line in place of the lowest (`LINE`): one minimum gives both.

    The periodic image is the nearest one at `now`; separation and velocity are then taken at the later local
    time, so that the result depends on nothing but the two rows and the image. Where lists store the image,
    and on wall axes, INVERSE is 0 here.
    """
    scratch, row = s.scratch, s.row
    ri = i * at.ROW
    px, py, pz = row[ri + at.X], row[ri + at.X + 1], row[ri + at.X + 2]
    pu, pv, pw = row[ri + at.V], row[ri + at.V + 1], row[ri + at.V + 2]
    ti = row[ri + at.T]
    lx, ly, lz = s.number[at.BOX], s.number[at.BOX + 1], s.number[at.BOX + 2]
    ix, iy, iz = s.number[at.INVERSE], s.number[at.INVERSE + 1], s.number[at.INVERSE + 2]
    named = s.counter[at.IMAGES] == 1
    sigma2 = s.number[at.SIGMA2]
    radius = row[ri + at.RADIUS]
    full = 2.0 * s.number[at.COMMON_RADIUS]
    scale, rate = s.number[at.SCALE], s.number[at.GROWTH]
    if GRAVITY:
        ax, ay, az = s.number[at.PULL], s.number[at.PULL + 1], s.number[at.PULL + 2]
        half_ax, half_ay, half_az = 0.5 * ax, 0.5 * ay, 0.5 * az
    soonest = NO_TIME
    for k in range(m):
        tj = scratch[table + SINCE + k]
        later = max(ti, tj)  # the earlier row is flown on to this time, the later one is as it was written
        dti, dtj = later - ti, later - tj
        ago = now - later
        vx, vy = scratch[table + VEL + k], scratch[table + VEL + at.LANES + k]
        u, v = pu - vx, pv - vy
        x = (px + pu * dti) - (scratch[table + PLACE + k] + vx * dtj)
        y = (py + pv * dti) - (scratch[table + PLACE + at.LANES + k] + vy * dtj)
        if GRAVITY:
            u, v = (pu + ax * dti) - (vx + ax * dtj), (pv + ay * dti) - (vy + ay * dtj)
            x = (px + (pu + half_ax * dti) * dti) - (scratch[table + PLACE + k] + (vx + half_ax * dtj) * dtj)
            y = (py + (pv + half_ay * dti) * dti) - (
                scratch[table + PLACE + at.LANES + k] + (vy + half_ay * dtj) * dtj
            )
        x -= lx * (scratch[table + SHIFT + k] if named else rint((x + u * ago) * ix))
        y -= ly * (scratch[table + SHIFT + at.LANES + k] if named else rint((y + v * ago) * iy))
        if SIZES:
            full = radius + scratch[table + SIZE + k]
            sigma2 = full * full
        z, w = 0.0, 0.0
        if DIM == 3:
            vz = scratch[table + VEL + 2 * at.LANES + k]
            w = pw - vz
            z = (pz + pw * dti) - (scratch[table + PLACE + 2 * at.LANES + k] + vz * dtj)
            if GRAVITY:
                w = (pw + az * dti) - (vz + az * dtj)
                z = (pz + (pw + half_az * dti) * dti) - (
                    scratch[table + PLACE + 2 * at.LANES + k] + (vz + half_az * dtj) * dtj
                )
            z -= lz * (scratch[table + SHIFT + 2 * at.LANES + k] if named else rint((z + w * ago) * iz))
            b = x * u + y * v + z * w
            rr = x * x + y * y + z * z
            d = discriminant_3d(x, y, z, u, v, w, sigma2)
        else:
            b = x * u + y * v
            rr = x * x + y * y
            d = discriminant_2d(x, y, u, v, sigma2)
        root = math.sqrt(max(d, 0.0))  # where d < 0 the pair misses: `contact_time` sees a root of 0
        contact = contact_time(b, rr - sigma2, root)
        if GROWS:
            contact = growing_contact(x, y, z, u, v, w, full * (scale + rate * later), full * rate)
        time = later + contact
        scratch[table + WHEN + k] = time
        soonest = min(soonest, (bits(time) & ~LINE) | k)  # integers: their minimum is a vector instruction
    return soonest


@jit
def solve_obstacles(s, table, i, now, entry):
    """Put right, in a table of neighbours of i, the times of those that do not fall; return the soonest."""
    soonest = NO_TIME
    for k in range(at.LANES):
        j = s.neighbours[entry + k]
        if j < s.counter[at.N] and is_obstacle(s, j):
            s.scratch[table + WHEN + k] = obstacle_contact(s, table, i, j, k, now)
        soonest = min(soonest, (bits(s.scratch[table + WHEN + k]) & ~LINE) | k)
    return soonest


@jit
def obstacle_contact(s, table, i, j, k, now):
    """Contact time of i, which falls, with obstacle j.

    Line k of the table has the obstacle's image, where it is stored.
    """
    ri, rj = i * at.ROW, j * at.ROW
    ti = s.row[ri + at.T]
    x, y = apart(s, table, ri, rj, 0, k, now - ti), apart(s, table, ri, rj, 1, k, now - ti)
    z, w, az = 0.0, 0.0, 0.0
    if DIM == 3:
        z, w, az = apart(s, table, ri, rj, 2, k, now - ti), s.row[ri + at.V + 2], s.number[at.PULL + 2]
    sigma = full_contact(s, i, j)
    return ti + falling_contact_time(
        x,
        y,
        z,
        s.row[ri + at.V],
        s.row[ri + at.V + 1],
        w,
        s.number[at.PULL],
        s.number[at.PULL + 1],
        az,
        sigma * sigma,
        s.number[at.EPOCH_LENGTH] - ti,
    )


@jit
def apart(s, table, ri, rj, d, k, ago):
    """Separation of two rows along axis d in the stored image, or in that which is the nearest at `now`."""
    x = s.row[ri + at.X + d] - s.row[rj + at.X + d]
    if s.counter[at.IMAGES] == 1:
        return x - s.number[at.BOX + d] * s.scratch[table + SHIFT + d * at.LANES + k]
    return x - s.number[at.BOX + d] * rint((x + s.row[ri + at.V + d] * ago) * s.number[at.INVERSE + d])


@jit
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
        return s.row[i * at.ROW + at.RADIUS] + s.row[j * at.ROW + at.RADIUS]
    return 2.0 * s.number[at.COMMON_RADIUS]


@jit
def rint(x):
    """Nearest integer (ties to even) of |x| < 2^51, by an addition that leaves no room for the fraction."""
    return (x + 6755399441055744.0) - 6755399441055744.0


@jit
def wall_contact(s, i):
    """Time and wall (n + 2 axis + side) of i's next wall; never, where no wall lies ahead."""
    if GRAVITY:
        return falling_wall_contact(s, i)
    row = s.row
    ri = i * at.ROW
    time = NEVER
    wall = at.NOTHING
    radius = row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    for d in range(DIM):
        v = row[ri + at.V + d]
        lower, upper = row[ri + at.X + d] - radius, (s.number[at.BOX + d] - radius) - row[ri + at.X + d]
        t = row[ri + at.T] + max(upper if v > 0.0 else lower, 0.0) / abs(v)
        sooner = (s.number[at.INVERSE + d] == 0.0) & (v != 0.0) & (t < time)
        time = t if sooner else time
        wall = s.counter[at.N] + 2 * d + (1 if v > 0.0 else 0) if sooner else wall
    return time, wall


@jit
def toward_wall(s, i, d, side):
    """Speed of i towards a wall of axis d when its row was written, gap (not negative), and acceleration."""
    ri = i * at.ROW
    radius = s.row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    x, v, pull = s.row[ri + at.X + d], s.row[ri + at.V + d], s.number[at.PULL + d]
    if side:
        return v, max((s.number[at.BOX + d] - radius) - x, 0.0), pull
    return -v, max(x - radius, 0.0), -pull


@jit
def speed_at_wall(s, i, d, side):
    """Speed along axis d with which i comes to a wall; 0 where it does not come so far."""
    pull = s.number[at.PULL + d]
    if pull == 0.0:
        return abs(s.row[i * at.ROW + at.V + d])
    square = s.fall[i * at.FALL + d]
    if (pull > 0.0) == (side == 1):
        return math.sqrt(square)
    radius = s.row[i * at.ROW + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    return climbed_speed(square, s.number[at.BOX + d] - 2.0 * radius, abs(pull))


@jit
def note_fall(s, i):
    """Note the squared speeds of i at the walls that it is pulled to; it has just met another particle."""
    for d in range(DIM):
        pull = s.number[at.PULL + d]
        toward, gap, _ = toward_wall(s, i, d, 1 if pull > 0.0 else 0)
        s.fall[i * at.FALL + d] = impact_square(toward, gap, abs(pull))


@jit
def falling_wall_contact(s, i):
    """As `wall_contact` under gravity: what rises may fall back, to the wall that it has left."""
    time = NEVER
    wall = at.NOTHING
    for d in range(DIM):
        if s.number[at.INVERSE + d] == 0.0:
            for side in range(2):
                toward, gap, pull = toward_wall(s, i, d, side)
                root = speed_at_wall(s, i, d, side)
                t = s.row[i * at.ROW + at.T] + impact_time(toward, gap, pull, root)
                if t < time:
                    time = t
                    wall = s.counter[at.N] + 2 * d + side
    return time, wall


@jit
def growing_wall_contact(s, i):
    """As `wall_contact` for a sphere that grows: it may touch the wall that it flies away from."""
    ri = i * at.ROW
    time = NEVER
    wall = at.NOTHING
    full = s.row[ri + at.RADIUS] if SIZES else s.number[at.COMMON_RADIUS]
    radius = full * (s.number[at.SCALE] + s.number[at.GROWTH] * s.row[ri + at.T])
    for d in range(DIM):
        if s.number[at.INVERSE + d] == 0.0:
            x, v = s.row[ri + at.X + d], s.row[ri + at.V + d]
            for side in range(2):
                approach = full * s.number[at.GROWTH] + (v if side else -v)
                gap = (s.number[at.BOX + d] - radius) - x if side else x - radius
                if approach > 0.0:
                    t = s.row[ri + at.T] + max(gap, 0.0) / approach
                    if t < time:
                        time = t
                        wall = s.counter[at.N] + 2 * d + side
    return time, wall


@jit
def pair_contact(s, i, j, about):
    """Time of contact of one pair, in the image that is the nearest at about that time."""
    copy_row(s, 0, j)
    solve(s, 0, i, about, 1)
    return s.scratch[WHEN]
