"""The study that studies/README.md shows: what is written there runs, in another folder, as a program of its own."""

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import studies

SMALL = ["--n", "108", "--packing-fraction", "0.1,0.2", "--frames", "20", "--replicas", "4"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the example in it."""
    text = (Path(studies.__file__).parent / "README.md").read_text(encoding="utf-8")
    (source,) = re.findall(r"^```py\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    place = tmp_path_factory.mktemp("own")
    (place / "contact.py").write_text(source, encoding="utf-8")
    return place


def contact(folder, *options):
    return subprocess.run(
        [sys.executable, "contact.py", *SMALL, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )


def test_it_runs_and_agrees_with_theory(folder):
    """g at contact to 5 standard errors at both packing fractions: the study's own check, false once in 1e6 runs."""
    done = contact(folder, "--workers", "1", "--json", "--out", "one")
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["study"] == "contact" and summary["checks"]["passed"]
    rows = list(csv.DictReader((folder / "one" / "contact.csv").open()))
    assert [row["quantity"] for row in rows] == ["g at contact"] * 2
    values = [state["measured"][0]["value"] for state in summary["states"]]
    assert [float(row["value"]) for row in rows] == values and 1.1 < values[0] < values[1] < 2.1
    assert len((folder / "contact.py").read_text().split("\n")) < 110


def test_bad_input_is_one_sentence(folder):
    done = contact(folder, "--frames", "3", "--out", "bad")
    assert done.returncode == 2 and done.stderr == "error: --frames 3 is out of range; ask for 10 to 100000\n"
    assert not (folder / "bad").exists()


@pytest.mark.slow
def test_workers_change_nothing(folder):
    for workers in ("1", "2"):
        done = contact(folder, "--workers", workers, "--out", f"workers-{workers}")
        assert done.returncode == 0, done.stderr
    for name in ("contact.csv", "pair_distribution.csv"):
        assert (folder / "workers-1" / name).read_bytes() == (folder / "workers-2" / name).read_bytes()
