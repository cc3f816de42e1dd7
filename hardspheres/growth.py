r"""The time of contact of two growing spheres, for dense random starts.

Lubachevsky and Stillinger (J. Stat. Phys. 60, 561 (1990), doi:10.1007/BF01025983) let spheres move and
collide while their diameters grow linearly in time. The contact distance of a pair is then :math:`\sigma + g
t`, and the two touch when

.. math:: |\mathbf r + \mathbf v t|^2 = (\sigma + g t)^2, \qquad a t^2 + 2 b t + c = 0,

with :math:`a = v^2 - g^2`, :math:`b = \mathbf r \cdot \mathbf v - \sigma g`, :math:`c = r^2 - \sigma^2` and
the discriminant :math:`D = b^2 - a c`. Everything is as in `hardspheres.collision` with :math:`(\mathbf r,
\sigma)` and :math:`(\mathbf v, g)` in place of :math:`\mathbf r` and :math:`\mathbf v`, in products whose
last term has a minus sign; Lagrange's identity holds for these too, and turns the discriminant into

.. math:: D = |\sigma \mathbf v - g \mathbf r|^2 - |\mathbf r \times \mathbf v|^2 ,

in which no large terms cancel for spheres far apart. Which root is the contact, with :math:`c > 0` before it?

- :math:`b < 0`, the surfaces approach: :math:`t = c / (-b + \sqrt D)`, the first root, without cancellation.
  Only for :math:`a > 0` can :math:`D` be negative, a miss.
- :math:`b \ge 0` and :math:`a \ge 0`: never.
- :math:`b \ge 0` and :math:`a < 0`: the surfaces separate, but the contact distance grows faster than the
  centres separate in the long run. The roots have opposite signs, and the positive one is :math:`t = (b +
  \sqrt D) / (-a)`.

Touching spheres (:math:`c \le 0`, by a rounding) collide now if :math:`b < 0`. If :math:`b \ge 0` and
:math:`a < 0`, the last formula still gives their next contact; where rounding leaves :math:`D < 0`, it gives
the time at which they cease to separate, :math:`b / (-a)`.

In the collision the relative velocity of the *surfaces* along the line of centres is reversed: from
:math:`v_n - g < 0` to :math:`g - v_n`, so the centres then part with :math:`v_n' = 2 g - v_n > g`. That is
`hardspheres.collision.impulse` with :math:`b = \mathbf r \cdot \mathbf v - |\mathbf r| g`. Momentum is
conserved; kinetic energy grows, as in any gas that is compressed. At a wall the surface of a sphere of radius
:math:`R` approaches faster by :math:`\dot R`, and is reflected in the same way.
"""

from typing import Any

__all__ = ["growing_contact_time", "growing_discriminant", "rebound_from_wall"]

Number = Any  # as in `collision`


def growing_discriminant(
    x: Number, y: Number, z: Number, u: Number, v: Number, w: Number, sigma: Number, g: Number
) -> Number:
    """Discriminant |sigma v - g r|^2 - |r x v|^2 for r = (x, y, z), velocity (u, v, w); discs have z = w = 0.

    sigma is the contact distance now, g its rate of growth.
    """
    px = sigma * u - g * x
    py = sigma * v - g * y
    pz = sigma * w - g * z
    cx = y * w - z * v
    cy = z * u - x * w
    cz = x * v - y * u
    return (px * px + py * py + pz * pz) - (cx * cx + cy * cy + cz * cz)


def growing_contact_time(a: Number, b: Number, c: Number, root: Number) -> Number:
    """Time until two growing spheres in free flight touch.

    Parameters
    ----------
    a : number
        v.v - g^2 with g the rate of growth of the contact distance sigma, [length^2/time^2].
    b : number
        r.v - sigma g, [length^2/time]; negative while the surfaces approach.
    c : number
        r.r - sigma^2, [length^2]; not positive where they touch or overlap.
    root : number
        Square root of the discriminant, 0 where that is negative, [length^2/time].

    Returns
    -------
    number
        The first time >= 0 at which they touch and approach; infinity if there is none. For g = 0 this is
        `hardspheres.collision.contact_time`.

    References
    ----------
    Lubachevsky, Stillinger, J. Stat. Phys. 60, 561 (1990), doi:10.1007/BF01025983; the event-driven form for
    any growth: Donev, Torquato, Stillinger, J. Comput. Phys. 202, 737 (2005), doi:10.1016/j.jcp.2004.08.014.
    """
    approach = b < 0.0
    above = max(c, 0.0) if approach else b + root
    below = root - b if approach else -a
    miss = approach and c > 0.0 and root == 0.0 and a > 0.0
    if below > 0.0 and not miss:
        return above / below
    return float("inf")


def rebound_from_wall(toward: Number, growth: Number) -> Number:
    """Speed away from the wall after a collision; incoming speed `toward`, rate of radius `growth`."""
    return toward + 2 * growth
