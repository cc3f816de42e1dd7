"""The end of a neighbour list's shell, for a row that was written far outside of it."""

import math
import sys
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest
from scenes import gas

import hardspheres as hs
from hardspheres import collision

EPS = float(np.finfo(np.float64).eps)
SHELL = 0.125


@pytest.fixture(params=["3d", "2d"])
def kernel(request, monkeypatch):
    """`threshold_crossing` as plain Python, and the names of its slots."""
    loop = hs.Simulation(gas(request.param, 20, {"3d": 0.4, "2d": 0.5}[request.param]))._engine.kernels
    module = sys.modules[loop.__name__.rpartition(".")[0] + ".dense.prediction"]
    for name in ("discriminant_2d", "discriminant_3d"):
        monkeypatch.setattr(module, name, getattr(collision, name))
    return getattr(module.threshold_crossing, "py_func", module.threshold_crossing), loop.at


def off(kernel, distance, offset, rng, cancelling=False):
    """By how many shells the place at the predicted end misses the shell; it flies there from `distance` shells away."""
    threshold_crossing, at = kernel
    along, across = np.linalg.qr(rng.normal(size=(at.DIM, at.DIM)))[0][:2]
    v = 1.37 * along
    centre = rng.normal(size=at.DIM)
    row, event, number = np.zeros(at.ROW), np.zeros(at.EVENT), np.zeros(at.NUMBERS)
    row[at.X : at.X + at.DIM] = centre + SHELL * (offset * across - distance * along)
    row[at.V : at.V + at.DIM] = v
    event[at.REFERENCE : at.REFERENCE + at.DIM] = centre
    number[at.DISPLACEMENT_THRESHOLD] = SHELL
    u = row[at.X : at.X + at.DIM] - centre
    if cancelling:
        b, vv = u @ v, v @ v
        time = (math.sqrt(max(b * b - vv * (u @ u - SHELL * SHELL), 0.0)) - b) / vv
    else:
        time = threshold_crossing(SimpleNamespace(row=row, event_float=event, number=number), 0, 0.0)
    with mpmath.workdps(50):
        end = [
            mpmath.mpf(x) + mpmath.mpf(w) * mpmath.mpf(time)
            for x, w in zip(u.tolist(), v.tolist(), strict=True)
        ]
        return float(abs(mpmath.sqrt(sum(x * x for x in end)) / SHELL - 1))


def worst(kernel, distance, **more):
    rng = np.random.default_rng(1)
    return max(off(kernel, distance, offset, rng, **more) for offset in (0.0, 0.3, 0.9) for _ in range(20))


@pytest.mark.parametrize("distance", [-0.9, -0.1, 0.5, 1e2, 1e4, 1e7, 1e9])
def test_the_end_of_a_shell_is_off_by_roundings_of_the_distance(kernel, distance):
    """Lists reach a millionth further than they must: that covers a flight of 1e9 shells."""
    assert worst(kernel, distance) <= 16.0 * EPS * max(abs(distance), 1.0) / math.sqrt(1.0 - 0.9**2)


def test_a_discriminant_that_cancels_would_miss_the_shell(kernel):
    """Sibling: with b^2 - v^2 c the end is off by far more than lists allow for, from 1e7 shells away."""
    assert worst(kernel, 1e7, cancelling=True) > 1e-3 > 1e4 * worst(kernel, 1e7)
