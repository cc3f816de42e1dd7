r"""The elastic collision of two spheres of any masses, and the time until they touch.

Two spheres with masses :math:`m_1, m_2` and velocities :math:`\mathbf v_1, \mathbf v_2` touch; the line of
centres runs along :math:`\mathbf r = \mathbf x_1 - \mathbf x_2`, its unit vector is :math:`\mathbf n =
\mathbf r / |\mathbf r|`. The impulse between smooth spheres acts along :math:`\mathbf n`, so each velocity is
split in two parts:

1. No force acts perpendicular to the line of centres: :math:`\mathbf v_k - (\mathbf v_k \cdot \mathbf
   n)\,\mathbf n` is unchanged.
2. Along it the parts :math:`v_k = \mathbf v_k \cdot \mathbf n` change as in a collision in one dimension.
   Momentum and kinetic energy are conserved,

   .. math:: m_1 v_1 + m_2 v_2 = m_1 v_1' + m_2 v_2', \qquad
             \tfrac12 m_1 v_1^2 + \tfrac12 m_2 v_2^2 = \tfrac12 m_1 v_1'^2 + \tfrac12 m_2 v_2'^2 .

3. Collect each sphere on one side: :math:`m_1 (v_1 - v_1') = m_2 (v_2' - v_2)` and :math:`m_1
   (v_1 - v_1')(v_1 + v_1') = m_2 (v_2' - v_2)(v_2' + v_2)`. Dividing (the velocities did change) leaves
   :math:`v_1 + v_1' = v_2 + v_2'`: the relative velocity along the line of centres is reversed.
4. Put :math:`v_2' = v_1 + v_1' - v_2` into the conservation of momentum and solve:

   .. math:: v_1' = \frac{(m_1 - m_2) v_1 + 2 m_2 v_2}{m_1 + m_2}, \qquad
             v_2' = \frac{2 m_1 v_1 + (m_2 - m_1) v_2}{m_1 + m_2} .

   This is the rule for a collision in one dimension, `one_dimensional_rule`.
5. The same as an exchange of momentum: :math:`m_1 (v_1' - v_1) = -2 \mu (v_1 - v_2)` with the reduced mass
   :math:`\mu = m_1 m_2 / (m_1 + m_2)`. With :math:`b = \mathbf r \cdot (\mathbf v_1 - \mathbf v_2)`, so that
   :math:`v_1 - v_2 = b / |\mathbf r|`, and :math:`\mathbf n = \mathbf r / |\mathbf r|`,

   .. math:: \Delta \mathbf p = -2 \mu \frac{b}{\mathbf r \cdot \mathbf r}\, \mathbf r, \qquad
             \mathbf v_1' = \mathbf v_1 + \Delta \mathbf p / m_1, \quad
             \mathbf v_2' = \mathbf v_2 - \Delta \mathbf p / m_2 .

   No square root, no unit vector. It contains the actual :math:`\mathbf r \cdot \mathbf r`, not the squared
   contact distance :math:`\sigma^2`: kinetic energy is then conserved to a rounding for *any* :math:`\mathbf
   r`, however the contact was rounded. The engine uses this form, `impulse`; where masses differ,
   `impulse_of_masses`.
6. If :math:`m_2` grows without bound, :math:`\mu \to m_1` and :math:`\Delta \mathbf p / m_2 \to 0`: sphere 2
   keeps its velocity. An obstacle is that limit, with the velocity 0: `reduced_mass`.

When do they touch? In free flight :math:`|\mathbf r + \mathbf v t|^2 = \sigma^2` with :math:`\mathbf v =
\mathbf v_1 - \mathbf v_2` is :math:`v^2 t^2 + 2 b t + c = 0`, :math:`c = r^2 - \sigma^2`. The first root is
:math:`t = (-b - \sqrt D) / v^2` with :math:`D = b^2 - v^2 c`; multiplied by :math:`(-b + \sqrt D)` above and
below it becomes

.. math:: t = \frac{c}{-b + \sqrt D} ,

which has no cancellation for approaching spheres (:math:`b < 0`). Bannerman, Strobl, Formella and Poeschel
(2014, doi:10.1007/s40571-014-0021-8) show that the rule "receding: never; overlapping and approaching: now;
else this root" stays stable however the rounding falls. Lagrange's identity :math:`b^2 = v^2 r^2 - |\mathbf r
\times \mathbf v|^2` turns :math:`D` into :math:`v^2 \sigma^2 - |\mathbf r \times \mathbf v|^2`, in which no
terms of size :math:`v^2 r^2` cancel: contacts of spheres a thousand diameters apart are as accurate as those
of neighbours.

The functions have no loops and assume no number type: Numba compiles them into the engine, and the reference
solver calls them with floats or with 50-digit numbers.
"""

import math
from collections.abc import Sequence
from typing import Any

__all__ = [
    "contact_time",
    "discriminant_2d",
    "discriminant_3d",
    "elastic_collision",
    "impulse",
    "impulse_of_masses",
    "one_dimensional_rule",
    "reduced_mass",
]

Number = Any  # float, numpy.float64, mpmath.mpf, fractions.Fraction: anything with + - x / and <


def one_dimensional_rule(m1: Number, v1: Number, m2: Number, v2: Number) -> tuple[Number, Number]:
    """Velocities along the line of centres after the collision (equation 4 of the module's text).

    Parameters
    ----------
    m1, m2 : number
        Masses.
    v1, v2 : number
        Velocity components along the line of centres before the collision, [length/time].

    Returns
    -------
    v1_after, v2_after : number
        The components after it. Exact in exact arithmetic.
    """
    total = m1 + m2
    return ((m1 - m2) * v1 + 2 * m2 * v2) / total, (2 * m1 * v1 + (m2 - m1) * v2) / total


def reduced_mass(mass1: Number, mass2: Number) -> Number:
    """Return m1 m2 / (m1 + m2), [mass]; where one of them is infinite, the other."""
    if mass1 == math.inf or mass2 == math.inf:
        return mass1 if mass2 == math.inf else mass2
    return mass1 * mass2 / (mass1 + mass2)


def impulse(b: Number, rr: Number, reduced_mass: Number) -> Number:
    """Momentum that sphere 1 gains per unit of separation r (equation 5): dp = impulse * r.

    Parameters
    ----------
    b : number
        r.v with r = x1 - x2 and v = v1 - v2, [length^2/time]; negative for approaching spheres.
    rr : number
        r.r as it is, not the squared contact distance, [length^2].
    reduced_mass : number
        m1 m2 / (m1 + m2), [mass].

    Returns
    -------
    number
        -2 mu b / r.r, [mass/time]; positive: a push apart.
    """
    return -2 * reduced_mass * (b / rr)


def impulse_of_masses(b: Number, rr: Number, mass1: Number, mass2: Number) -> Number:
    """Momentum as by `impulse`, in a form whose rounding is symmetric under exchange of unequal masses.

    A reduced mass computed once for a pair has the same rounding error in all its collisions, which makes the
    energy drift by up to 5e-16 / N per collision. Here each mass is multiplied by b / r.r first, which
    differs every time, so that the roundings are independent.

    Parameters
    ----------
    b, rr : number
        As for `impulse`; b is not 0, but for floating-point numbers whose division by 0 gives infinity.
    mass1, mass2 : number
        Masses, [mass].

    Returns
    -------
    number
        -2 mu b / r.r, [mass/time].
    """
    rate = b / rr
    return -2 / (1 / (rate * mass1) + 1 / (rate * mass2))


def discriminant_2d(x: Number, y: Number, u: Number, v: Number, sigma2: Number) -> Number:
    """Discriminant v^2 sigma^2 - |r x v|^2 for discs: r = (x, y), velocity (u, v), sigma2 = sigma^2."""
    cross = x * v - y * u
    return (u * u + v * v) * sigma2 - cross * cross


def discriminant_3d(
    x: Number, y: Number, z: Number, u: Number, v: Number, w: Number, sigma2: Number
) -> Number:
    """Discriminant v^2 sigma^2 - |r x v|^2 for spheres: r = (x, y, z), velocity (u, v, w)."""
    cx = y * w - z * v
    cy = z * u - x * w
    cz = x * v - y * u
    return (u * u + v * v + w * w) * sigma2 - (cx * cx + cy * cy + cz * cz)


def contact_time(b: Number, c: Number, root: Number) -> Number:
    """Time until two spheres in free flight touch.

    Parameters
    ----------
    b : number
        r.v, [length^2/time].
    c : number
        r.r - sigma^2, [length^2]; not positive where they touch or overlap.
    root : number
        Square root of the discriminant, 0 where that is negative, [length^2/time].

    Returns
    -------
    number
        c / (-b + root) >= 0; 0 for spheres that approach and overlap already; infinity for spheres that
        recede or miss. The error of the contact distance is a few roundings of the separation.

    References
    ----------
    Bannerman, Strobl, Formella, Poeschel, Comp. Part. Mech. 1, 191 (2014), doi:10.1007/s40571-014-0021-8.
    """
    if b < 0.0 and (c <= 0.0 or root > 0.0):
        return max(c, 0.0) / (root - b)
    return float("inf")


def elastic_collision(
    mass1: Number,
    velocity1: Sequence[Number],
    mass2: Number,
    velocity2: Sequence[Number],
    separation: Sequence[Number],
) -> tuple[list[Number], list[Number]]:
    """Velocities of two spheres after they collided, in any dimension and any number type.

    Parameters
    ----------
    mass1, mass2 : number
        Masses; not both infinite.
    velocity1, velocity2 : (d,) sequence of numbers
        Velocities before the collision, [length/time].
    separation : (d,) sequence of numbers
        x1 - x2 at contact, [length]; its length need not be the contact distance exactly.

    Returns
    -------
    velocity1_after, velocity2_after : (d,) list of numbers
        Momentum and kinetic energy are those before, to a rounding.
    """
    b = sum(r * (v - w) for r, v, w in zip(separation, velocity1, velocity2, strict=True))
    rr = sum(r * r for r in separation)
    push = impulse(b, rr, reduced_mass(mass1, mass2))
    return (
        [v + push / mass1 * r for v, r in zip(velocity1, separation, strict=True)],
        [w - push / mass2 * r for w, r in zip(velocity2, separation, strict=True)],
    )
