r"""Walls under gravity: when a ball that falls touches one, and how fast it is then.

All particles have the same constant acceleration :math:`\mathbf a`. Between events :math:`\mathbf x(t) =
\mathbf x + \mathbf v t + \mathbf a t^2 / 2`, so the separation of two particles changes as :math:`\mathbf r
+ \mathbf v_{12} t`, in a straight line: contacts of pairs are those of `hardspheres.collision`. Seen from a
frame that falls with the particles, every flight is straight. Only walls are different.

A ball with a gap :math:`c` to a wall, the speed :math:`u` towards it (negative: away) and the acceleration
:math:`p` towards it touches it when :math:`p t^2 / 2 + u t - c = 0`. By the energy its speed is then
:math:`\sqrt D`, with :math:`D = u^2 + 2 p c`, and

.. math:: t = \frac{2 c}{u + \sqrt D} \quad (u > 0), \qquad
          t = \frac{\sqrt D - u}{p} \quad (u \le 0, p > 0),

neither of which cancels. A wall that the ball rises towards (:math:`p < 0`) is not reached if :math:`D \le
0`; :math:`D = 0` is grazing, a touch without an impulse. For :math:`p = 0` the first is :math:`c / u`.

The bounce reverses :math:`\sqrt D`, not the velocity after so much time, and puts the ball at the wall
exactly, so the rounding of times never enters the energy. What a ball has at the wall that it is pulled to,
:math:`v^2 + 2 p c`, stays as it is until it meets another ball, and is kept: so every one of its bounces has
the same speed, to the last bit, and its height has no drift even after 1e9 of them.

A bounce lasts for :math:`2 u / p` and rises by :math:`u^2 / 2 p`. Elastic balls never come to rest, but two
that collide right at the floor may leave one there with no speed, or next to none. Then bounces, lower than
the rounding of a radius, would follow each other without end, so the engine stops and says which ball it is.
"""

from typing import Any

__all__ = ["impact_square", "impact_time"]

Number = Any  # as in `collision`


def impact_square(toward: Number, gap: Number, pull: Number) -> Number:
    """Square D of the speed at which a ball touches a wall; not positive where it does not come so far.

    Parameters
    ----------
    toward : number
        Its speed towards the wall now, [length/time]; negative: away.
    gap : number
        How far it is from touching, not negative, [length].
    pull : number
        Acceleration towards the wall, [length/time^2]; negative: away.

    Returns
    -------
    number
        toward^2 + 2 pull gap, [length^2/time^2].
    """
    return toward * toward + 2 * pull * gap


def impact_time(toward: Number, gap: Number, pull: Number, root: Number) -> Number:
    """Time until a ball touches a wall.

    Parameters
    ----------
    toward, gap, pull : number
        As for `impact_square`.
    root : number
        Square root of that, 0 where it is negative, [length/time].

    Returns
    -------
    number
        The time, at least 0; infinity if it does not touch the wall or only grazes it.
    """
    if toward > 0.0:
        return 2 * gap / (toward + root) if root > 0.0 or gap == 0.0 else float("inf")
    return (root - toward) / pull if pull > 0.0 else float("inf")
