"""What is printed of curves, and what is written."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from studies.answer import Answer, Column, Curves, curve_files
from studies.free_path import FreePaths
from studies.report import Screen

S = np.array([0.0, 1.0])
ERROR, NO_THEORY = np.array([0.01, 0.01]), np.full(2, np.nan)


def column(**more):
    return Column(np.array([0.5, 0.25]), ERROR, **more)


def test_columns_that_are_not_printed_are_in_the_file():
    """Also what has no error bar, after the axes; sibling: a column that is printed is in both."""
    curves = Curves({"s": S}, {"a": column(title="A"), "b": column(printed=False)}, True, {"time": 3.0 * S})
    assert curves.rows()[0] == ["s", "A"]
    assert list(curves.flat()) == ["s", "time", "a", "a_error", "b", "b_error"]
    gas = SimpleNamespace(packing_fraction=0.1)
    assert list(curve_files([Answer(gas, [], {"x": curves})])["x"]) == list(curves.flat())


def test_theory_that_says_nothing_anywhere_is_not_printed():
    """In the file it stands; sibling: theory at one point has its columns."""
    known = np.array([np.nan, 0.25])
    for theory, titles in ((NO_THEORY, ["s", "a"]), (known, ["s", "a", "theory", "z"])):
        curves = Curves({"s": S}, {"a": column(theory=theory, uncertainty=0.0 * S, z=NO_THEORY)}, True)
        assert curves.rows()[0] == titles and "a_theory" in curves.flat()


def test_a_measurement_better_than_its_theory_is_marked():
    """Only where z is known, and whatever is printed of the uncertainty; sibling: a theory that is sharp."""
    for uncertainty, better in ((0.03, True), (0.01, False)):
        found = column(
            theory=np.array([0.5, 0.26]),
            uncertainty=np.full(2, uncertainty),
            z=np.array([np.nan, -0.3]),
            brief=True,
        )
        curves = Curves({"s": S}, {"a": found}, printed=True)
        first, second = curves.rows()[1]
        assert first[-2:] == ["0.5000", ""] and second[-2:] == ["0.2600", "-0.3 u" if better else "-0.3"]
        assert Answer(None, [], {"x": curves}).better_than_theory is better
        unprinted = Curves({"s": S}, {"a": found})
        assert not Answer(None, [], {"x": unprinted}).better_than_theory


def test_a_run_that_breaks_is_among_the_failures(monkeypatch):
    """Sibling: one that does not."""
    study = FreePaths(n=100, packing_fractions=(0.05,), collisions_per_particle=20.0, workers=1, seed=5)
    assert not any(answer.failures for answer in study.answers(Screen(json_output=True)))
    monkeypatch.setattr("studies.study.broken", lambda simulation: "energy drifted")
    (answer,) = study.answers(Screen(json_output=True))
    assert list(answer.failures)[:2] == ["replica 0: energy drifted", "replica 1: energy drifted"]


def test_without_pandas_a_sentence_says_how_to_get_it(monkeypatch):
    """Nothing else needs it."""
    monkeypatch.setitem(sys.modules, "pandas", None)
    curves = Curves({"s": S}, {"a": column()})
    answer = Answer(SimpleNamespace(packing_fraction=0.1), [], {"x": curves})
    for asked in (answer.to_dataframe, curves.to_dataframe):
        with pytest.raises(ImportError, match="not installed here: pip install pandas$"):
            asked()
    assert repr(answer) and answer._repr_html_()
