"""The screen: standard output holds what it promises, and says what was done."""

import json
import math

import pytest

from studies.output import OutputFolder
from studies.report import Screen, engine_rate, figure_style, say_checks


def test_standard_output_holds_json_alone(capsys):
    screen = Screen(json_output=True)
    screen.say("a result")
    screen.table("title", ["x"], [["1"]])
    screen.finish({"x": math.nan})
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"x": None}
    assert "a result" in captured.err and "title" in captured.err


def test_without_json_results_go_to_standard_output(capsys):
    screen = Screen()
    screen.say("a result with [brackets]")
    screen.note("a note")
    with screen.progress("replicas", 3) as advance:
        advance()
    screen.finish({"x": 1})
    captured = capsys.readouterr()
    assert captured.out == "a result with [brackets]\n"
    assert captured.err == "a note\n"  # no progress bar where there is no terminal


def test_figures_have_one_style():
    import matplotlib

    before = matplotlib.rcParams["axes.spines.top"]
    with figure_style():
        assert matplotlib.rcParams["axes.spines.top"] is False
    assert matplotlib.rcParams["axes.spines.top"] == before


def test_the_rate_of_the_engine_stands_beside_that_of_the_study(capsys):
    """Both named; siblings: a run too short to be timed tells the study's alone, and gases on several threads."""
    summary = {
        "collisions": 1000,
        "seconds": {"total": 2.0},
        "workers": 1,
        "threads": [1],
        "collisions_per_second": 12_345.0,
        "engine_collisions_per_second": 1_234_567.0,
        "checks": {"worst_energy_drift": 1e-16, "late_events": 0, "failures": []},
        "files": ["summary.json"],
    }
    say_checks(Screen(), summary, OutputFolder("x"))
    told = capsys.readouterr().out
    assert "1 200 000 of the engine's event loop alone, 12 000 of the study" in told
    say_checks(Screen(), summary | {"engine_collisions_per_second": math.nan}, OutputFolder("x"))
    told = capsys.readouterr().out
    assert "engine" not in told and "collisions per second and core: 12 000 of the study" in told
    for threads, words in (([2], "on 2 threads"), ([1, 4], "on 1 to 4 threads")):
        say_checks(Screen(), summary | {"threads": threads}, OutputFolder("x"))
        told = capsys.readouterr().out
        assert f"collisions per second of a gas {words}: 1 200 000 of the engine's event loop alone" in told


def test_workers_are_told_how_busy_they_were(capsys):
    """Siblings: one worker, and a run that was finished before, of which nothing is known."""
    summary = {
        "collisions": 1000,
        "seconds": {"total": 2.0, "workers_busy": 0.934},
        "workers": 2,
        "threads": [1],
        "collisions_per_second": 12_345.0,
        "engine_collisions_per_second": math.nan,
        "checks": {"worst_energy_drift": 1e-16, "late_events": 0, "failures": []},
        "files": ["summary.json"],
    }
    say_checks(Screen(), summary, OutputFolder("x"))
    assert "\n2 workers, busy 93 % of the time\n" in capsys.readouterr().out
    for other in ({"workers": 1}, {"seconds": {"total": 2.0}}):
        say_checks(Screen(), summary | other, OutputFolder("x"))
        assert "busy" not in capsys.readouterr().out


def test_the_engine_s_rate_is_of_all_runs_that_were_timed():
    """1000 collisions in 1 s and 3000 in 1 s; sibling: the mean of both rates."""
    statuses = [
        {"collisions": 1000, "collisions_per_second": 1000.0},
        {"collisions": 3000, "collisions_per_second": 3000.0},
        {"collisions": 5, "collisions_per_second": math.nan},
    ]
    assert engine_rate(statuses) == pytest.approx(2000.0)
    statuses[0]["collisions_per_second"] = 500.0
    assert engine_rate(statuses) == pytest.approx(4000.0 / 3.0) != pytest.approx(1750.0)
    assert math.isnan(engine_rate(statuses[2:]))


def test_compiling_is_told_when_it_took_time(capsys):
    """Numba's own clock; sibling: nothing is compiled, and nothing said."""
    from numba.core import event

    screen = Screen()
    with screen.compiling("hard discs, wall box"):
        pass
    assert capsys.readouterr().err == ""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.report.WORTH_SAYING", 0.0)
        with screen.compiling("hard discs, wall box"), event.trigger_event("numba:compile"):
            pass
    told = capsys.readouterr().err
    assert told.startswith("compiled the engine for hard discs, wall box in 0 s") and "kind:" in told
