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
exactly, so the rounding of times never enters the energy, and what a climb to the wall opposite takes is
known to more than a rounding (`climbed_speed`). What a ball has at the wall that it is pulled to,
:math:`v^2 + 2 p c`, stays as it is until it meets another ball, and is kept: so every one of its bounces has
the same speed, to the last bit, and its height has no drift even after 1e9 of them.

A bounce lasts for :math:`2 u / p` and rises by :math:`u^2 / 2 p`. Elastic balls never come to rest, but two
that collide right at the floor may leave one there with no speed, or next to none. Then bounces, lower than
the rounding of a radius, would follow each other without end, so the engine stops and says which ball it is.
"""

import math
from typing import Any

__all__ = ["climbed_speed", "impact_square", "impact_time"]

Number = Any  # as in `collision`
SPLIT = 134217729.0  # 2^27 + 1 parts a float64 into two halves


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


def climbed_speed(square: float, height: float, pull: float) -> float:
    """Speed that is left at the wall opposite to that at which a ball has a speed, correctly rounded.

    The product 2 pull height is the same at every such wall, and so would be its rounding: energy would grow,
    or fall, a little with each. So the speed is corrected by what all steps have rounded off (Dekker, Numer.
    Math. 18, 224 (1971), doi 10.1007/BF01397083).

    Parameters
    ----------
    square : float
        Square of the speed at the wall that the ball is pulled to, [length^2/time^2].
    height : float
        Way between touching one wall and the other, [length].
    pull : float
        Acceleration back, positive, [length/time^2].

    Returns
    -------
    float
        Square root of square - 2 pull height, [length/time]; 0 where the ball does not come so far.
    """
    product = pull * height
    left = square - 2.0 * product
    a, b = pull * SPLIT, height * SPLIT
    a, b = a - (a - pull), b - (b - height)  # the upper halves of their digits
    c, d = pull - a, height - b
    off = (square - left) - 2.0 * product - 2.0 * (c * d - (((product - a * b) - c * b) - a * d))
    if not left + off > 0.0:
        return 0.0
    root = math.sqrt(left + off)
    again = root * root
    a = root * SPLIT
    a -= a - root
    b = root - a
    off += (left - again) - (b * b - ((again - a * a) - 2.0 * a * b))
    return root + 0.5 * off / root


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
