"""Output: whole files or none, JSON that is JSON, standard output that holds what it promises."""

import csv
import json
import math

import numpy as np
import pytest

from hardspheres import HardSpheresError
from studies.report import OutputError, OutputFolder, Screen, figure_style, jsonable


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
