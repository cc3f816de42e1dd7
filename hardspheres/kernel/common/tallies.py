"""What each event adds to the sums of the pressure tensor: virial, kinetic stress, wall impulses.

The virial is a sum over collisions. The kinetic part is an integral over time of sum m v_a v_b, which is
constant between events: each event adds its change, and the change times its time. The integral follows from
these sums, what they have added up to in earlier epochs, and the present velocities (`Engine.tallied`),
without a look at all particles at each event.

The heat flux, where it is tallied, has the same two parts: energy E = m v^2/2 that collisions pass from one
centre to the other, and sum v_a E between events.

All sums are those of `hardspheres.sums`: the order in which events are added decides no bit.
"""

from hardspheres import sums

from .. import layout as at
from ..flags import DIM, GROWS, HEAT, MASSES
from ..simd.jit import jit
from ..simd.vectors import add_terms

accumulated = jit(sums.accumulated)


@jit
def add(s, k, terms):
    """Add terms, in their units, to the sums from k on."""
    add_terms(s.total, k, at.SUMS, terms)


@jit
def tally_stress(s, k, change, t):
    """Add a change, at time t, of component k of sum m v_a v_b, the kinetic part of the pressure."""
    add(s, at.STRESS + k, (change * s.number[at.PER_STRESS],))
    add(s, at.STRESS_MOMENT + k, (change * t * s.number[at.PER_STRESS_MOMENT],))


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
            k = a if a == b else a + b + at.SHEAR
            change = (c + p * dt) * dt
            moment = change * s.row[ri + at.T] + (0.5 * c + 2.0 / 3.0 * p * dt) * dt * dt
            add(s, at.STRESS + k, (change * s.number[at.PER_STRESS],))
            add(s, at.STRESS_MOMENT + k, (moment * s.number[at.PER_STRESS_MOMENT],))


@jit
def tally_epoch(s):
    """At the end of an epoch, all rows there, add its part to the integrals; the next has its own moments."""
    for k in range(at.TENSOR):
        integrate(s, at.STRESS_INTEGRAL + k, at.STRESS + k, at.STRESS_MOMENT + k, s.number[at.PER_STRESS])
    if HEAT:
        for k in range(3):
            per_unit = s.number[at.PER_HEAT_FLUX]
            integrate(s, at.HEAT_INTEGRAL + k, at.HEAT_FLUX + k, at.HEAT_MOMENT + k, per_unit)


@jit
def integrate(s, k, changes, moment, per_unit):
    """Add to integral k that of a sum of changes over an epoch: what it is at its end, less its moment."""
    unit = s.number[at.EPOCH_LENGTH] / per_unit
    more = (s.total[changes] - s.total[moment]) * unit
    rest = (s.total[changes + at.SUMS] - s.total[moment + at.SUMS]) * unit
    s.integral[k], s.integral[k + at.INTEGRALS] = accumulated(
        s.integral[k], s.integral[k + at.INTEGRALS], more, rest
    )
    s.total[moment], s.total[moment + at.SUMS] = 0.0, 0.0


@jit
def tally_pair(s, push, t, x, y, z, u, v, w, scale):
    """Add a collision with impulse push (x, y, z), scale (x, y, z) apart; (u, v, w): old plus new v_ij."""
    if GROWS:
        s.number[at.GROWTH_VIRIAL] += scale * push * x * x
        s.number[at.GROWTH_VIRIAL + 1] += scale * push * y * y
        s.number[at.GROWTH_VIRIAL + 2] += scale * push * z * z
    virial, stress = scale * push * s.number[at.PER_VIRIAL], push * s.number[at.PER_STRESS]
    late = t * s.number[at.PER_EPOCH]  # in the units of moments
    xu, yv, xy = stress * x * u, stress * y * v, 0.5 * stress * (x * v + y * u)
    vx, vy = virial * x, virial * y
    if DIM == 3:
        vz, zw = virial * z, stress * z * w
        xz, yz = 0.5 * stress * (x * w + z * u), 0.5 * stress * (y * w + z * v)
        terms = (
            (vx * x, vy * y, vz * z, vx * y, vx * z, vy * z)
            + (xu, yv, zw, xy, xz, yz)
            + (xu * late, yv * late, zw * late, xy * late, xz * late, yz * late)
            + (0.0, 0.0)
        )
    else:
        terms = (vx * x, vy * y, vx * y) + (xu, yv, xy) + (xu * late, yv * late, xy * late) + (0.0, 0.0, 0.0)
    add(s, at.VIRIAL, terms)


@jit
def tally_obstacle(s, push, x, y, z):
    """Add a collision that gave an obstacle the momentum push (x, y, z)."""
    s.counter[at.OBSTACLE_HITS] += 1
    push *= s.number[at.PER_IMPULSE]
    add(s, at.LEDGER, (push * x, push * y, push * z))


@jit
def tally_weight(s, t):
    """Take off the momentum that gravity has given in a time."""
    t *= s.number[at.PER_IMPULSE]
    for d in range(DIM):
        add(s, at.LEDGER + d, (-s.number[at.WEIGHT + d] * t,))


@jit
def energy(s, i):
    """Kinetic energy of row i."""
    ri = i * at.ROW
    square = s.row[ri + at.V] * s.row[ri + at.V] + s.row[ri + at.V + 1] * s.row[ri + at.V + 1]
    if DIM == 3:
        square += s.row[ri + at.V + 2] * s.row[ri + at.V + 2]
    return 0.5 * (s.mass[i] if MASSES else s.number[at.MASS]) * square


@jit
def tally_flux(s, a, change, t):
    """Add a change, at time t, of sum v_a E."""
    add(s, at.HEAT_FLUX + a, (change * s.number[at.PER_HEAT_FLUX],))
    add(s, at.HEAT_MOMENT + a, (change * t * s.number[at.PER_HEAT_MOMENT],))


@jit
def tally_heat_flux(s, i, j, sign, t):
    """Add or take off what rows i and j are of sum v_a E, at time t; the same bits in either order."""
    ei, ej = energy(s, i), energy(s, j)
    for a in range(DIM):
        tally_flux(s, a, sign * (s.row[i * at.ROW + at.V + a] * ei + s.row[j * at.ROW + at.V + a] * ej), t)


@jit
def tally_heat_transfer(s, i, j, before, x, y, z, scale):
    """Add a collision, scale (x, y, z) apart; before: E_i - E_j then. Either order gives the same bits."""
    passed = 0.5 * scale * (energy(s, i) - energy(s, j) - before) * s.number[at.PER_HEAT_TRANSFER]
    add(s, at.HEAT_TRANSFER, (passed * x, passed * y, passed * z))


@jit
def tally_heat_of_wall(s, i, axis, t):
    """Add what a reflection, which is done, has changed of sum v_a E: only the sign of one velocity."""
    tally_flux(s, axis, 2.0 * s.row[i * at.ROW + at.V + axis] * energy(s, i), t)


@jit
def tally_wall(s, axis, side, impulse, radius):
    """Add the momentum that a particle gave to a wall (positive: outwards)."""
    given = impulse * s.number[at.PER_IMPULSE]
    add(s, at.LEDGER + axis, (given if side else -given,))
    add(s, at.WALL_IMPULSE + 2 * axis + side, (given,))
    add(s, at.WALL_RADIUS_IMPULSE + 2 * axis + side, (impulse * radius * s.number[at.PER_VIRIAL],))
