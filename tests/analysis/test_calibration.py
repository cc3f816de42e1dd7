"""The test of error bars is itself tested: right ones pass, wrong ones fail, each in its own way."""

import math

import numpy as np
import pytest

from analysis.calibration import calibrate
from analysis.statistics import Estimate


def estimates(rng, runs=400, samples=12, inflate=1.0, bias=0.0):
    drawn = rng.normal(3.0, 2.0, (runs, samples))
    errors = inflate * drawn.std(axis=1, ddof=1) / math.sqrt(samples)
    pairs = zip(drawn.mean(axis=1) + bias, errors, strict=True)
    return [Estimate(value, error, samples, samples - 1) for value, error in pairs]


def test_students_t_passes_and_others_fail():
    rng = np.random.default_rng(1)
    right = [calibrate(estimates(rng), 3.0) for _ in range(40)]
    assert sum(result.passed for result in right) >= 39  # false alarm: 0.3 % and 0.1 %
    assert np.mean([r.spread for r in right]) == pytest.approx(right[0].expected_spread, abs=0.02)
    assert right[0].expected_spread == pytest.approx(math.sqrt(11 / 9))
    assert np.std([r.spread for r in right]) == pytest.approx(right[0].spread_error, rel=0.4)
    for wrong in ({"inflate": 0.8}, {"inflate": 1.25}, {"bias": 0.2}):
        result = calibrate(estimates(rng, **wrong), 3.0)
        assert not result.passed and "NOT" in str(result)
    # normal pulls where Student's t with few degrees of freedom was quoted
    few = [Estimate(v, 1.0, 6, 5) for v in rng.standard_normal(2000)]
    assert not calibrate(few, 0.0).passed
    assert calibrate([Estimate(v, 1.0) for v in rng.standard_normal(400)], 0.0).passed


def test_misuse_is_named():
    with pytest.raises(ValueError, match="3 runs"):
        calibrate([Estimate(0.0, 1.0)] * 3, 0.0)
    with pytest.raises(ValueError, match="more than 4 degrees"):
        calibrate([Estimate(0.0, 1.0, 5, 4)] * 20, 0.0)
