"""Output: whole files or none, JSON that is JSON, standard output that holds what it promises."""

import csv
import json
import math

import numpy as np
import pytest

from hardspheres import HardSpheresError
from studies.report import (
    OutputError,
    OutputFolder,
    Screen,
    engine_rate,
    figure_style,
    jsonable,
    say_checks,
)


def test_jsonable_is_strict_json(tmp_path):
    content = {
        "a": np.float64(1.5),
        "b": np.array([1.0, math.nan]),
        "c": (1, math.inf),
        "d": tmp_path,
        3: np.int64(4),
    }
    text = json.dumps(jsonable(content), allow_nan=False)
    assert json.loads(text) == {"a": 1.5, "b": [1.0, None], "c": [1, None], "d": str(tmp_path), "3": 4}


def test_files_appear_whole_or_not_at_all(tmp_path):
    out = OutputFolder(tmp_path / "deep" / "run")
    out.check()
    assert not (tmp_path / "deep").exists()
    out.create()
    out.write_json("summary.json", {"x": 1})
    with pytest.raises(RuntimeError), out.partial("summary.json") as path:
        path.write_text("half a file")
        raise RuntimeError
    assert json.loads((out.path / "summary.json").read_text()) == {"x": 1}
    assert [path.name for path in out.path.iterdir()] == ["summary.json"]
    assert out.files == ["summary.json"]


def test_csv_reads_back_bit_by_bit(tmp_path):
    out = OutputFolder(tmp_path)
    columns = {"s": np.array([0.0, 0.1, 1 / 3]), "z": np.array([math.nan, -1e-300, 2.0])}
    out.write_csv("relaxation.csv", columns)
    with (tmp_path / "relaxation.csv").open() as handle:
        rows = list(csv.DictReader(handle))
    for name, column in columns.items():
        np.testing.assert_array_equal([float(row[name]) for row in rows], column)


def test_unusable_folders_are_named(tmp_path):
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OutputError, match="give another"):
            OutputFolder(path).check()
    assert issubclass(OutputError, HardSpheresError)


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
    """Both named; sibling: a run too short to be timed tells the study's alone."""
    summary = {
        "collisions": 1000,
        "seconds": {"total": 2.0},
        "collisions_per_second_and_core": 12_345.0,
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
