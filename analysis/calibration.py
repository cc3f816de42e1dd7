"""Whether error bars are right: many independent runs of an estimator against a known truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.statistics import Estimate

__all__ = ["Calibration", "calibrate"]


@dataclass(frozen=True)
class Calibration:
    """How (value - truth) / standard error is distributed over independent runs.

    Attributes
    ----------
    n_runs : int
        Number of runs R.
    mean, mean_error : float
        Mean of the pulls, 0 for an unbiased estimator, and its standard error.
    spread, expected_spread, spread_error : float
        Standard deviation of the pulls, that of Student's t with the quoted degrees of freedom, and the
        standard error of the difference. Above: error bars are too small.
    p_value : float
        Kolmogorov-Smirnov test of the pulls against each run's own Student's t.
    """

    n_runs: int
    mean: float
    mean_error: float
    spread: float
    expected_spread: float
    spread_error: float
    p_value: float

    @property
    def passed(self) -> bool:
        """Whether p > 0.001 and the spread is within 3 standard errors of what it should be."""
        return self.p_value > 1e-3 and abs(self.spread - self.expected_spread) < 3.0 * self.spread_error

    def __repr__(self) -> str:
        """Return the calibration in one line."""
        return f"<Calibration of {self}>"

    def __str__(self) -> str:
        """Return the calibration in one line."""
        verdict = "calibrated" if self.passed else "NOT calibrated"
        return (
            f"{self.n_runs} runs: mean pull {self.mean:+.2f} +- {self.mean_error:.2f}, spread "
            f"{self.spread:.3f} "
            f"(Student's t: {self.expected_spread:.3f} +- {self.spread_error:.3f}), KS p = "
            f"{self.p_value:.3g}, {verdict}"
        )


def calibrate(estimates: Sequence[Estimate], truth: float, uncertainty: float = 0.0) -> Calibration:
    """Return how well the error bars of independent runs cover a known true value.

    Parameters
    ----------
    estimates : sequence of Estimate
        One per run, at least 10, each with more than 4 degrees of freedom.
    truth : float
        What all of them estimate.
    uncertainty : float, default 0
        Standard uncertainty of the truth, the same for all; it is added to each error, so keep it well below.

    Raises
    ------
    ValueError
        If there are fewer than 10 runs, or one has no standard error or at most 4 degrees of freedom: the
        spread of Student's t has no standard error then.
    """
    freedom = np.array([estimate.degrees_of_freedom for estimate in estimates])
    pulls = np.array([estimate.deviation(truth, uncertainty) for estimate in estimates])
    runs = len(pulls)
    if runs < 10 or not np.isfinite(pulls).all() or not np.all(freedom > 4.0):
        raise ValueError(
            f"{runs} runs; a calibration needs at least 10, each with a standard error of more than 4 "
            "degrees of freedom"
        )
    from scipy import stats  # loaded where it is needed: it takes long

    finite = np.minimum(freedom, 1e9)
    p_value = float(stats.kstest(stats.t.cdf(pulls, finite), "uniform").pvalue)
    variance = finite / (finite - 2.0)
    fourth = variance**2 * (3.0 + 6.0 / (finite - 4.0))
    spread, expected = float(pulls.std(ddof=1)), math.sqrt(float(variance.mean()))
    error = math.sqrt((float(fourth.mean()) - float(variance.mean()) ** 2) / runs) / (2.0 * expected)
    return Calibration(runs, float(pulls.mean()), spread / math.sqrt(runs), spread, expected, error, p_value)
