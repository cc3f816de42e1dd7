r"""A ball that falls, and an obstacle, which does not: when they touch.

Two particles that fall together approach each other along a straight line (`hardspheres.gravity`); beside an
obstacle the path is a parabola, :math:`\mathbf R(t) = \mathbf r + \mathbf v t + \mathbf a t^2 / 2`, and they
touch at the first root of the quartic :math:`p(t) = R^2 - \sigma^2` at which they approach: :math:`b(t) =
\mathbf R \cdot \mathbf V < 0`, with :math:`\mathbf V = \mathbf v + \mathbf a t`. No closed form of that root
is exact to rounding. It is found between bounds instead, which no rounding can miss:

1. :math:`db/dt = V^2 + \mathbf a \cdot \mathbf R` is a quadratic. Between its roots :math:`b` is monotonic.
2. So :math:`b` has one root at most in each of these parts; it parts the rise of :math:`p` from its descent.
3. On a descent from :math:`p > 0` to :math:`p \le 0` lies one root, which Newton's method finds, with
   bisection where a step would leave the bounds.

:math:`p` and :math:`b` are computed from the vectors, not from the quartic's coefficients, and :math:`p(t) -
p(0)` from the way since then. So the contact distance is as exact as rows are, and even the lowest bounce has
its time to a rounding. Rounding follows the rule of straight paths (`hardspheres.collision`):
overlapping and approaching is now. A ball that leaves an obstacle is not met before :math:`p` has risen to
its maximum. Where that is not above 0, by rounding, the ball has left by less than that: it then returns when
it is as deep as it was.
"""

import math

__all__ = ["falling_contact_time"]

STEPS = 200  # of Newton's method or bisection; more than any pair of doubles needs


def falling_contact_time(
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    w: float,
    ax: float,
    ay: float,
    az: float,
    sigma2: float,
    horizon: float,
) -> float:
    """Time until a ball that falls touches an obstacle.

    Parameters
    ----------
    x, y, z : float
        Separation r from the obstacle to the ball, [length]; z = 0 for discs.
    u, v, w : float
        Velocity of the ball, [length/time].
    ax, ay, az : float
        Its acceleration, not 0, [length/time^2].
    sigma2 : float
        Squared contact distance, [length^2].
    horizon : float
        Contacts later than that are not looked for, [time].

    Returns
    -------
    float
        The time, at least 0; infinity where they do not touch until then.
    """
    rr, b = x * x + y * y + z * z, x * u + y * v + z * w
    c = rr - sigma2
    if b < 0.0 and c <= 0.0:
        return 0.0
    vv, aa, av = u * u + v * v + w * w, ax * ax + ay * ay + az * az, ax * u + ay * v + az * w
    reach = math.sqrt(sigma2) + (math.sqrt(vv) + 0.5 * math.sqrt(aa) * horizon) * horizon
    if rr > 1.000001 * reach * reach:
        return math.inf
    hx, hy, hz = 0.5 * ax, 0.5 * ay, 0.5 * az
    # The roots of db/dt = 3/2 aa t^2 + 3 av t + bend, in the form in which nothing cancels.
    bend = vv + (ax * x + ay * y + az * z)
    square = 9.0 * av * av - 6.0 * aa * bend
    first, second = horizon, horizon
    if square > 0.0:
        root = math.sqrt(square)
        far = -(3.0 * av + root) if av > 0.0 else root - 3.0 * av
        one, other = far / (3.0 * aa), 2.0 * bend / far
        first = min(max(min(one, other), 0.0), horizon)
        second = min(max(one, other, 0.0), horizon)
    right, b_right = 0.0, b
    for part in range(3):
        left, b_left = right, b_right
        right = first if part == 0 else (second if part == 1 else horizon)
        if not left < right:
            continue
        b_right = (
            (x + (u + hx * right) * right) * (u + ax * right)
            + (y + (v + hy * right) * right) * (v + ay * right)
            + (z + (w + hz * right) * right) * (w + az * right)
        )
        if b_left >= 0.0 and b_right >= 0.0:
            continue
        low, high, t = left, right, right
        if (b_left < 0.0) != (b_right < 0.0):  # where b is 0
            t = 0.5 * (low + high)
            for _ in range(STEPS):
                px, py, pz = x + (u + hx * t) * t, y + (v + hy * t) * t, z + (w + hz * t) * t
                pu, pv, pw = u + ax * t, v + ay * t, w + az * t
                b = px * pu + py * pv + pz * pw
                if (b < 0.0) == (b_left < 0.0):
                    low = t
                else:
                    high = t
                slope = (pu * pu + pv * pv + pw * pw) + (ax * px + ay * py + az * pz)
                step = t - b / slope if slope != 0.0 else low
                if not low < step < high:
                    step = 0.5 * (low + high)
                    if not low < step < high:
                        break
                if step == t:
                    break
                t = step
        # The descent, and whether it comes to the contact distance. R^2 - r^2 = (2 r + d).d, with the way d.
        low, high = (left, t) if b_left < 0.0 else (t, right)
        dx, dy, dz = (u + hx * low) * low, (v + hy * low) * low, (w + hz * low) * low
        above = (x + x + dx) * dx + (y + y + dy) * dy + (z + z + dz) * dz
        start = c if above + c > 0.0 else 0.0
        if above + start <= 0.0:
            return low
        dx, dy, dz = (u + hx * high) * high, (v + hy * high) * high, (w + hz * high) * high
        if (x + x + dx) * dx + (y + y + dy) * dy + (z + z + dz) * dz + start > 0.0:
            continue
        t = 0.5 * (low + high)
        for _ in range(STEPS):
            dx, dy, dz = (u + hx * t) * t, (v + hy * t) * t, (w + hz * t) * t
            above = (x + x + dx) * dx + (y + y + dy) * dy + (z + z + dz) * dz + start
            if above > 0.0:
                low = t
            else:
                high = t
            b = (x + dx) * (u + ax * t) + (y + dy) * (v + ay * t) + (z + dz) * (w + az * t)
            step = t - 0.5 * above / b if b < 0.0 else low
            if not low < step < high:
                step = 0.5 * (low + high)
                if not low < step < high:
                    break
            if step == t:
                break
            t = step
        return t
    return math.inf
