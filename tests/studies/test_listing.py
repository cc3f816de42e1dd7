"""`hardspheres list`: finished, unfinished and damaged runs, newest first; folders of others are passed over."""

import json
import os
import sys

import pytest

from studies.cli import main
from studies.diffusion import SelfDiffusion
from studies.listing import runs_in
from studies.output import OutputFolder

from .test_screens import cut

GAS = "100 hard spheres, periodic box"


def summary(folder, **more):
    """What a finished run leaves: its summary, and a table."""
    folder.mkdir(parents=True)
    states = [{"gas": GAS, "packing_fraction": eta} for eta in (0.1, 0.3)]
    content = {"study": "pressure", "version": "0.1.0", "date": "2026-11-20", "options": {"replicas": 4}}
    content |= {"states": states, "files": ["summary.json", "a.csv"], "checks": {"passed": True}} | more
    (folder / "a.csv").write_text("x\n")
    (folder / "summary.json").write_text(json.dumps(content, indent=2))


def unfinished(folder, done=3):
    study = SelfDiffusion(n=64, packing_fractions=(0.1, 0.2), replicas=4)
    with pytest.raises(KeyboardInterrupt), OutputFolder(folder).running(study) as shelf:
        for k in range(done):
            shelf.store(k, 1.0)
        shelf.save(done, 2.0)
        raise KeyboardInterrupt


@pytest.fixture
def runs(tmp_path):
    """A folder with runs in every state, and what is none."""
    place = tmp_path / "runs"
    summary(place / "older", date="2026-11-19")
    summary(place / "failed", checks={"passed": False})
    summary(
        place / "swept", date="2026-11-18", sweep={"option": "n"}, states=[{"gas": GAS}, {"gas": "other"}]
    )
    summary(place / "missing", date="2026-11-17", files=["summary.json", "a.csv", "b.csv", "c.csv"])
    summary(place / "torn", date="2026-11-16")
    text = (place / "torn" / "summary.json").read_text()
    (place / "torn" / "summary.json").write_text(text[: len(text) // 2])
    unfinished(place / "begun")
    unfinished(place / "broken")
    manifest = place / "broken" / "checkpoint" / "manifest.json"
    manifest.write_text(manifest.read_text().replace("64", "65", 1))
    for folder in ("torn", "broken"):  # whose dates are those of their files
        file = place / folder / ("summary.json" if folder == "torn" else "checkpoint")
        os.utime(file, (1e9, 1e9))
    (place / "of-others").mkdir()
    (place / "of-others" / "letter.txt").write_text("mine")
    summary(place / "of-a-program", version=3)
    (place / "also").mkdir()
    (place / "also" / "summary.json").write_text("not JSON")
    (place / "checkpoint" / "deep").mkdir(parents=True)
    (place / "a-file").write_text("")
    return place


WANTED = {
    "begun": ("unfinished", "unfinished, 3 of 8 done"),
    "failed": ("finished", "finished, CHECK FAILED"),
    "older": ("finished", "finished"),
    "swept": ("finished", "finished"),
    "missing": ("damaged", "damaged: b.csv is missing, and 1 more"),
    "torn": ("damaged", "damaged: summary.json cannot be understood"),
    "broken": ("damaged", "damaged: checkpoint/manifest.json cannot be understood"),
}


def test_every_run_is_found_with_its_state_newest_first(runs):
    found = runs_in(runs)
    told = {os.path.basename(run.folder): (run.state, run.told) for run in found}
    assert told == WANTED
    assert [os.path.basename(run.folder) for run in found[:5]] == list(WANTED)[:5]
    by_name = {os.path.basename(run.folder): run for run in found}
    assert by_name["older"].gas == f"{GAS}, packing fractions 0.1 to 0.3" and by_name["older"].replicas == 4
    assert by_name["swept"].study == "pressure over n" and by_name["swept"].gas == f"{GAS}, and 1 more"
    begun = by_name["begun"]
    assert (begun.study, begun.replicas, begun.done, begun.runs) == ("diffusion", 4, 3, 8)
    assert begun.gas == "64 hard spheres, periodic box, packing fractions 0.1 to 0.2"


def test_a_run_itself_is_listed_too(runs):
    assert [run.told for run in runs_in(runs / "older")] == ["finished"]


def command(monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["hardspheres", "list", *map(str, options)])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code or 0


@pytest.mark.parametrize("width", [40, 80])
def test_it_can_be_read_in_a_narrow_window(width, runs, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(width))
    assert command(monkeypatch, runs) == 0
    lines = capsys.readouterr().out.split("\n")
    assert max(map(len, lines)) <= width
    rows = [[name, told] for name, (_, told) in WANTED.items()]
    assert cut(lines, [("", ["folder", "study", "state"], rows, {})]) == set()


def test_json_is_alone_on_standard_output(runs, monkeypatch, capsys):
    assert command(monkeypatch, runs, "--json") == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert found["folder"] == str(runs) and len(found["runs"]) == len(WANTED)
    assert {run["state"] for run in found["runs"]} == {"finished", "unfinished", "damaged"}
    assert "unfinished, 3 of 8 done" in told.err


def test_where_nothing_is_one_sentence_says_so(tmp_path, monkeypatch, capsys):
    """The usual folder may be missing; sibling: one that was named may not."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    for options, folder in (([], "runs"), (["empty"], "empty")):
        assert command(monkeypatch, *options) == 0
        told = capsys.readouterr()
        assert told.err == "" and told.out.count("\n") == 1 and f"there are no runs in {folder}; " in told.out
    (tmp_path / "a-file").write_text("")
    for folder, why in (("absent", "No such file or directory"), ("a-file", "Not a directory")):
        assert command(monkeypatch, folder) == 2
        told = capsys.readouterr()
        assert told.err.startswith(f"error: {folder} cannot be listed: {why}") and told.err.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a-file", "empty"]
