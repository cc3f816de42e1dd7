"""What each event adds to the sums of the pressure tensor: virial, kinetic stress, wall impulses.

The virial is a sum over collisions. The kinetic part is an integral over time of sum m v_a v_b, which is
constant between events: each event adds its change, and the change times its time. The integral follows from
these sums and the present velocities (`Engine.tallied`), without a look at all particles at each event.

The heat flux, where it is tallied, has the same two parts: energy E = m v^2/2 that collisions pass from one
centre to the other, and sum v_a E between events.
"""

from .. import layout as at
from ..flags import DIM, MASSES
from ..simd.jit import jit


@jit
def tally_stress(s, k, change, t):
    """Add a change, at time t, of component k of sum m v_a v_b, the kinetic part of the pressure."""
    s.total[at.STRESS + k] += change
    s.total[at.STRESS_MOMENT + k] += change * t
    s.total[at.STRESS_EPOCHS + k] += change * s.counter[at.EPOCH]


@jit
def tally_fall(s, i, dt):
    """Add what gravity changes of m v_a v_b while row i flies for a time: c t + p t^2, t from the row's."""
    ri = i * at.ROW
    mass = s.mass[i] if MASSES else s.number[at.MASS]
    for a in range(DIM):
        for b in range(a, DIM):
            pa, pb = s.number[at.PULL + a], s.number[at.PULL + b]
            if pa == 0.0 and pb == 0.0:
                continue
            c = mass * (s.row[ri + at.V + a] * pb + s.row[ri + at.V + b] * pa)
            p = mass * pa * pb
            k = a if a == b else a + b + 2
            change = (c + p * dt) * dt
            s.total[at.STRESS + k] += change
            moment = change * s.row[ri + at.T] + (0.5 * c + 2.0 / 3.0 * p * dt) * dt * dt
            s.total[at.STRESS_MOMENT + k] += moment
            s.total[at.STRESS_EPOCHS + k] += change * s.counter[at.EPOCH]


@jit
def tally_pair(s, push, t, x, y, z, u, v, w, scale):
    """Add a collision with impulse push (x, y, z), scale (x, y, z) apart; (u, v, w): old plus new v_ij."""
    s.total[at.VIRIAL] += scale * push * x * x
    s.total[at.VIRIAL + 1] += scale * push * y * y
    s.total[at.VIRIAL + 3] += scale * push * x * y
    tally_stress(s, 0, push * x * u, t)
    tally_stress(s, 1, push * y * v, t)
    tally_stress(s, 3, 0.5 * push * (x * v + y * u), t)
    if DIM == 3:
        s.total[at.VIRIAL + 2] += scale * push * z * z
        s.total[at.VIRIAL + 4] += scale * push * x * z
        s.total[at.VIRIAL + 5] += scale * push * y * z
        tally_stress(s, 2, push * z * w, t)
        tally_stress(s, 4, 0.5 * push * (x * w + z * u), t)
        tally_stress(s, 5, 0.5 * push * (y * w + z * v), t)


@jit
def tally_obstacle(s, push, x, y, z):
    """Add a collision that gave an obstacle the momentum push (x, y, z)."""
    s.counter[at.OBSTACLE_HITS] += 1
    s.total[at.LEDGER] += push * x
    s.total[at.LEDGER + 1] += push * y
    s.total[at.LEDGER + 2] += push * z


@jit
def energy(s, i):
    """Kinetic energy of row i."""
    ri = i * at.ROW
    square = s.row[ri + at.V] * s.row[ri + at.V] + s.row[ri + at.V + 1] * s.row[ri + at.V + 1]
    if DIM == 3:
        square += s.row[ri + at.V + 2] * s.row[ri + at.V + 2]
    return 0.5 * (s.mass[i] if MASSES else s.number[at.MASS]) * square


@jit
def tally_heat_flux(s, i, j, sign, t):
    """Add or take off what rows i and j are of sum v_a E, at time t; the same bits in either order."""
    ei, ej = energy(s, i), energy(s, j)
    for a in range(DIM):
        part = sign * (s.row[i * at.ROW + at.V + a] * ei + s.row[j * at.ROW + at.V + a] * ej)
        s.total[at.HEAT_FLUX + a] += part
        s.total[at.HEAT_MOMENT + a] += part * t
        s.total[at.HEAT_EPOCHS + a] += part * s.counter[at.EPOCH]


@jit
def tally_heat_transfer(s, i, j, before, x, y, z, scale):
    """Add a collision, scale (x, y, z) apart; before: E_i - E_j then. Either order gives the same bits."""
    passed = 0.5 * scale * (energy(s, i) - energy(s, j) - before)
    s.total[at.HEAT_TRANSFER] += passed * x
    s.total[at.HEAT_TRANSFER + 1] += passed * y
    if DIM == 3:
        s.total[at.HEAT_TRANSFER + 2] += passed * z


@jit
def tally_heat_of_wall(s, i, axis, t):
    """Add what a reflection, which is done, has changed of sum v_a E: only the sign of one velocity."""
    change = 2.0 * s.row[i * at.ROW + at.V + axis] * energy(s, i)
    s.total[at.HEAT_FLUX + axis] += change
    s.total[at.HEAT_MOMENT + axis] += change * t
    s.total[at.HEAT_EPOCHS + axis] += change * s.counter[at.EPOCH]


@jit
def tally_wall(s, axis, side, impulse, radius):
    """Add the momentum that a particle gave to a wall (positive: outwards)."""
    s.total[at.LEDGER + axis] += impulse if side else -impulse
    s.total[at.WALL_IMPULSE + 2 * axis + side] += impulse
    s.total[at.WALL_RADIUS_IMPULSE + 2 * axis + side] += impulse * radius
