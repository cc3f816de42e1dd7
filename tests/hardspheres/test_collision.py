"""The collision rule and the contact time: exact identities, and errors against 60-digit numbers."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hardspheres.collision import (
    contact_time,
    discriminant_2d,
    discriminant_3d,
    elastic_collision,
    impulse,
    impulse_of_masses,
    one_dimensional_rule,
)

EPS = np.finfo(float).eps
rationals = st.fractions(min_value=-100, max_value=100, max_denominator=1000)
masses = st.fractions(min_value=Fraction(1, 1000), max_value=1000, max_denominator=1000)


def test_a_collision_written_out():
    """Masses 1 and 3 meet at speeds 5 and -1: the centre of mass moves at 1/2, and both turn round as it sees them."""
    one, three, five = Fraction(1), Fraction(3), Fraction(5)
    assert one_dimensional_rule(one, five, three, -one) == (-4, 2)
    assert one_dimensional_rule(three, -one, one, five) == (2, -4)
    separation = [Fraction(-2), Fraction(0)]
    assert elastic_collision(one, [five, 7], three, [-one, 9], separation) == ([-4, 7], [2, 9])
    with pytest.raises(ValueError, match="shorter|longer"):
        elastic_collision(one, [five, 7], three, [-one, 9], [-2, 0, 0])


@given(masses, masses, rationals.filter(bool), rationals.filter(lambda x: x > 0))
def test_both_forms_of_the_impulse_are_one(m1, m2, b, rr):
    """-2 mu b / r.r with or without the reduced mass, in exact rationals."""
    assert (
        impulse_of_masses(b, rr, m1, m2)
        == impulse(b, rr, m1 * m2 / (m1 + m2))
        == -2 * m1 * m2 / (m1 + m2) * b / rr
    )


@given(masses, masses, rationals, rationals, st.lists(rationals, min_size=2, max_size=3).filter(any))
def test_impulse_form_is_the_one_dimensional_rule_exactly(m1, m2, v1, v2, r):
    """Along the line of centres both forms agree, across it nothing changes: in exact rationals, any masses, any r."""
    rr = sum(x * x for x in r)
    across = [-r[1], r[0], Fraction(0)][: len(r)]
    velocity1 = [v1 * x + 3 * y for x, y in zip(r, across, strict=True)]
    velocity2 = [v2 * x - 2 * y for x, y in zip(r, across, strict=True)]
    after1, after2 = elastic_collision(m1, velocity1, m2, velocity2, r)
    along1, along2 = one_dimensional_rule(m1, v1, m2, v2)
    assert after1 == [along1 * x + 3 * y for x, y in zip(r, across, strict=True)]
    assert after2 == [along2 * x - 2 * y for x, y in zip(r, across, strict=True)]
    assert m1 * along1 + m2 * along2 == m1 * v1 + m2 * v2
    assert m1 * along1**2 + m2 * along2**2 == m1 * v1**2 + m2 * v2**2
    assert impulse(rr * (v1 - v2), rr, m1 * m2 / (m1 + m2)) == m1 * (along1 - v1)


def test_a_rule_that_assumes_the_contact_distance_loses_energy():
    """Sibling: sigma^2 in place of r.r breaks the conservation that the impulse form keeps for any r."""
    r, sigma2 = [Fraction(11, 10), Fraction(0)], Fraction(1)
    b = r[0] * -2
    right, wrong = impulse(b, r[0] ** 2, Fraction(1, 2)), impulse(b, sigma2, Fraction(1, 2))
    for push, kept in ((right, True), (wrong, False)):
        v1, v2 = -1 + push * r[0], 1 - push * r[0]
        assert (v1**2 + v2**2 == 2) is kept


@given(
    st.floats(1e-6, 1e6),
    st.floats(1e-6, 1e6),
    st.lists(st.floats(-10, 10), min_size=9, max_size=9).filter(lambda x: sum(y * y for y in x[:3]) > 1e-3),
)
def test_momentum_and_energy_to_rounding(m1, m2, numbers):
    r, v1, v2 = numbers[:3], numbers[3:6], numbers[6:]
    w1, w2 = elastic_collision(m1, v1, m2, v2, r)
    scale = sum(m1 * abs(a) + m2 * abs(b) for a, b in zip(v1, v2, strict=True)) + m1 + m2
    for a, b, c, d in zip(v1, v2, w1, w2, strict=True):
        assert abs(m1 * a + m2 * b - m1 * c - m2 * d) <= 40 * EPS * scale * 10
    before = m1 * sum(a * a for a in v1) + m2 * sum(b * b for b in v2)
    after = m1 * sum(a * a for a in w1) + m2 * sum(b * b for b in w2)
    assert abs(after - before) <= 200 * EPS * (before + (m1 + m2) * 1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_both_discriminants_are_b2_minus_v2_c(dim):
    """Lagrange's identity, in exact rationals."""
    rng = np.random.default_rng(5)
    discriminant = discriminant_3d if dim == 3 else discriminant_2d
    for _ in range(50):
        r = [Fraction(int(x), 7) for x in rng.integers(-50, 50, dim)]
        v = [Fraction(int(x), 11) for x in rng.integers(-50, 50, dim)]
        b = sum(x * u for x, u in zip(r, v, strict=True))
        vv, rr = sum(u * u for u in v), sum(x * x for x in r)
        sigma2 = Fraction(9, 4)
        assert discriminant(*r, *v, sigma2) == b * b - vv * (rr - sigma2)


def test_the_three_cases_of_the_contact_rule():
    assert contact_time(1.0, -0.1, 1.0) == math.inf  # overlapping, receding: left alone
    assert contact_time(0.0, 0.0, 0.0) == math.inf
    assert contact_time(-1.0, -1e-3, 0.0) == 0.0  # overlapping, approaching: now
    assert contact_time(-1.0, 0.0, 1.0) == contact_time(-1.0, 0.0, 0.0) == 0.0
    assert contact_time(-1.0, 0.5, 0.0) == math.inf  # a miss
    assert contact_time(-2.0, 3.0, 1.0) == 1.0  # r = 2, v = -1, sigma = 1


def contact_error(distance, offset, naive):
    """Error, in diameters, of the distance at the computed contact of a float prediction from `distance` diameters."""
    direction = np.array([0.48, 0.6, 0.64])
    across = np.array([0.8, -0.64, 0.0]) / math.hypot(0.8, 0.64)
    r = (direction * distance + across * offset).tolist()
    v = (-direction * 1.37).tolist()
    b = sum(x * u for x, u in zip(r, v, strict=True))
    c = sum(x * x for x in r) - 1.0
    if naive:
        d = b * b - sum(u * u for u in v) * c
    else:
        d = discriminant_3d(*r, *v, 1.0)
    t = contact_time(b, c, math.sqrt(max(d, 0.0)))
    with mpmath.workdps(60):
        end = [mpmath.mpf(x) + mpmath.mpf(u) * mpmath.mpf(t) for x, u in zip(r, v, strict=True)]
        return float(abs(mpmath.sqrt(sum(x * x for x in end)) - 1))


@pytest.mark.parametrize("distance", [2.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6])
def test_contact_error_grows_with_the_distance_only(distance):
    """From 2 to 1e6 diameters the sphere stops within a few roundings of the *distance*; grazing costs a factor more."""
    for offset in (0.0, 0.3, 0.7, 0.95):
        allowed = 8 * EPS * distance / math.sqrt(1 - offset**2)
        assert contact_error(distance, offset, naive=False) <= allowed


def test_the_textbook_discriminant_fails_that_test():
    """Sibling: b^2 - v^2 c loses (r / sigma)^2 eps."""
    worst = max(contact_error(1e4, offset, naive=True) for offset in (0.3, 0.7, 0.95))
    assert worst > 50 * 8 * EPS * 1e4 / math.sqrt(1 - 0.95**2)
