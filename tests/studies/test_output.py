"""Output: whole files or none, JSON that is JSON, numbers that read back."""

import csv
import json
import math

import numpy as np
import pytest

from hardspheres import HardSpheresError
from studies.output import OutputError, OutputFolder, jsonable


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
