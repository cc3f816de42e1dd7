"""Several processes in one folder: each item once, the first result stays, nothing is lost with one that is killed."""

import contextlib
import json
import math
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

import hardspheres as hs
from hardspheres.errors import CheckpointError
from hardspheres.temporary import placing, temporary_beside
from studies.options import OptionError
from studies.output import OutputFolder
from studies.pressure import EquationOfState
from studies.recording import Trajectory
from studies.report import Screen
from studies.running import locking, presence
from studies.running.journal import Journal, OutputError, Shelf
from studies.running.presence import announce
from studies.running.shards import Shard, SharedShelf, run_part

from .test_resuming import Sums

STUDY = EquationOfState(packing_fractions=(0.1, 0.3), n=500, collisions_per_particle=50.0, replicas=3, seed=4)
ITEMS = list(enumerate([12, 999, 55, 7, 123456, 80, 31]))
SUMS = {k: sum(map(int, str(item))) for k, item in ITEMS}


def folder(path, shard=None, **options):
    out = OutputFolder(path, **options)
    out.shard = shard and Shard.parsed(shard)
    return out


def run(path, shard, task=None, study=STUDY, screen=None):
    out = folder(path, shard)
    out.check(study)
    with out.shared(study) as shelf:
        run_part(task or Sums(), ITEMS, shelf, screen or Screen(True), workers=1)


def results(path):
    shelf = Shelf(path / "checkpoint")
    return {k: found[0] for k, _ in ITEMS if (found := shelf.result(k)) is not None}


def killed(path, shard, number):
    """What a shard leaves that is killed while it runs an item: its file names a process that has ended."""

    class Killed(BaseException):
        pass

    class Dying(Sums):
        def steps(self, item, state):
            for _ in super().steps(item, state):
                if item == ITEMS[number][1] and state["sum"]:
                    yield  # it is saved here
                    raise Killed
                yield

    with pytest.MonkeyPatch.context() as patch, subprocess.Popen([sys.executable, "-c", ""]) as ended:
        patch.setattr("os.getpid", lambda: ended.pid)
        patch.setattr("studies.output.renewing", lambda _: contextlib.nullcontext())
        out = folder(path, shard, checkpoint_every=0.0)
        with pytest.raises(Killed), out.shared(STUDY) as shelf:
            run_part(Dying(), ITEMS, shelf, Screen(True), workers=1)


class Counting(Sums):
    """Notes what it begins."""

    def __init__(self):
        self.begun = []

    def begin(self, item):
        self.begun.append(item)
        return super().begin(item)


def test_parts_are_every_nth_and_all_together_everything():
    assert Shard.parsed("2/3").part(range(8)) == range(1, 8, 3) and str(Shard.parsed("2/3")) == "2/3"
    for count in (1, 3, 9):
        parts = [Shard(k, count).part(range(8)) for k in range(1, count + 1)]
        assert sorted(k for part in parts for k in part) == list(range(8))


@pytest.mark.parametrize(
    "text", ["4/3", "0/3", "x", "", "1", "1/", "/2", "-1/2", "1/0", "1.0/2", "1/2/3", "²/3"]
)
def test_a_shard_that_is_none_is_refused(text):
    with pytest.raises(OptionError, match="is not understood; give k/n with k from 1 to n, as in 2/3"):
        Shard.parsed(text)


def test_shards_one_after_the_other(tmp_path, capsys):
    run(tmp_path, "2/3")
    assert results(tmp_path) == {k: SUMS[k] for k in (1, 4)}
    assert capsys.readouterr().err.startswith(
        f"shard 2/3 has finished its 2 runs; 2 of the study's 7 are in {tmp_path}\n"
        "when all shards have ended, the same command with --resume in place of --shard 2/3 runs what is "
        "missing and writes the results\n"
    )
    run(tmp_path, "1/3")
    run(tmp_path, "3/3")
    assert results(tmp_path) == SUMS
    again = Counting()
    run(tmp_path, "1/3", again)
    run(tmp_path, "9/9", again)
    assert again.begun == []
    assert "shard 9/9 has nothing to run; 7 of the study's 7 are" in capsys.readouterr().err
    with folder(tmp_path, resume=True).running(STUDY):
        assert results(tmp_path) == SUMS
    assert not list(tmp_path.iterdir())  # claims too are gone


def test_shards_that_start_at_once_in_an_empty_folder(tmp_path):
    """Threads, each with a lock of its own, as processes have: a manifest, and everything is done."""
    for turn in range(10):
        path, barrier, tasks = tmp_path / str(turn), threading.Barrier(4), [Counting() for _ in range(4)]

        def start(k, path=path, barrier=barrier, tasks=tasks):
            barrier.wait()
            run(path, f"{max(k, 1)}/3", tasks[k])  # the first one twice

        with ThreadPoolExecutor(4) as pool:
            assert list(pool.map(start, range(4))) == [None] * 4
        assert results(path) == SUMS
        assert sum(len(task.begun) for task in tasks) >= len(ITEMS)


@pytest.mark.parametrize("late", [False, True])
def test_what_a_shard_does_while_another_begins_is_not_removed(late, tmp_path, monkeypatch):
    """One looks at the folder for leftovers when the other begins, and even finishes."""
    run(tmp_path, "2/3")
    left = {path.name: path.read_bytes() for path in (tmp_path / "checkpoint").glob("done-*")}
    (tmp_path / "checkpoint" / "manifest.json").unlink()  # as of a run that was killed while it tidied up
    half = temporary_beside(tmp_path / "checkpoint" / "done-0000.npz")  # what another one is just writing
    half.touch()
    out = folder(tmp_path, "3/3")
    listed, looked = Path.iterdir, []

    def looking(self):
        before = list(listed(self))
        if self.name == "checkpoint" and not looked:
            looked.append(1)
            run(tmp_path, "1/3")
        return iter(before if late else list(listed(self)))

    out.create()
    with out._journal.held(make=True, shared=True), monkeypatch.context() as patch:
        patch.setattr(Path, "iterdir", looking)
        out._journal.begin({})
    assert looked and results(tmp_path) == {
        k: SUMS[k] for k in (0, 3, 6)
    }  # nor are leftovers taken for results
    assert half.exists() and left.keys() == {"done-0001.npz", "done-0004.npz"}


def test_another_study_is_refused_whoever_was_first(tmp_path, monkeypatch):
    """Also where it was not there yet when this one looked."""
    other = replace(STUDY, seed=5)
    run(tmp_path / "one", "1/3")
    with pytest.raises(CheckpointError, match="unfinished run with --seed 4, not 5"):
        run(tmp_path / "one", "2/3", study=other)
    out = folder(tmp_path / "two", "2/3")
    with monkeypatch.context() as patch:

        def late(target):
            patch.undo()
            run(tmp_path / "two", "1/3")
            return placing(target)

        patch.setattr("studies.running.journal.placing", late)
        with pytest.raises(CheckpointError, match="unfinished run with --seed 4, not 5"):
            out.shared(other).__enter__()
    assert results(tmp_path / "two") == {k: SUMS[k] for k in (0, 3, 6)}


@pytest.mark.parametrize("look", range(5))
def test_another_shard_may_begin_after_any_look_at_the_manifest(look, tmp_path, monkeypatch):
    unfinished, looks = Journal.unfinished, []

    def looking(journal):
        found = unfinished(journal)
        looks.append(found)
        if len(looks) == look + 1:
            monkeypatch.setattr(Journal, "unfinished", unfinished)
            run(tmp_path, "1/3")
        return found

    monkeypatch.setattr(Journal, "unfinished", looking)
    run(tmp_path, "2/3")
    monkeypatch.setattr(Journal, "unfinished", unfinished)
    run(tmp_path, "3/3")
    run(tmp_path, "1/3")
    assert results(tmp_path) == SUMS and None in looks


def test_a_finished_run_is_nothing_for_a_shard(tmp_path):
    with folder(tmp_path).running(STUDY):
        out = OutputFolder(tmp_path)
    out.write_json("summary.json", {"study": "pressure", "version": "1", "files": ["summary.json"]})
    with pytest.raises(OutputError, match="finished run, so there is nothing left for a shard to do"):
        folder(tmp_path, "1/3").check(STUDY)


@pytest.mark.skipif(sys.platform == "win32", reason="there are no locks")
def test_no_other_run_while_a_shard_runs_nor_the_other_way_round(tmp_path):
    """It is named, with its host and process; another shard is welcome."""
    with folder(tmp_path, "2/3").shared(STUDY) as shelf:
        who = presence.Presence.of(shelf.presence)
        for out in (folder(tmp_path), folder(tmp_path, resume=True), folder(tmp_path, force=True)):
            for use in (out.check, lambda study, out=out: out.running(study).__enter__()):
                with pytest.raises(OutputError) as caught:
                    use(STUDY)
                assert str(caught.value) == (
                    f"shard 2/3 (host {who.host}, process {who.process}) still writes into {tmp_path}; wait "
                    "until it has ended, or give another folder with --out"
                )
        run(tmp_path, "1/3")
    with folder(tmp_path, resume=True).running(STUDY):
        for use in (
            folder(tmp_path, "1/3").check,
            lambda study: folder(tmp_path, "1/3").shared(study).__enter__(),
        ):
            with pytest.raises(OutputError, match="another run writes into"):
                use(STUDY)


@pytest.mark.parametrize("runs", [True, False])
def test_where_there_are_no_locks_a_shard_is_known_by_its_file(runs, tmp_path, monkeypatch):
    """Or where locks are known to one host alone, and the shard runs on another."""
    for name, value in (("BEAT", 0.05), ("STALE", 0.4), ("LOOK", 0.01)):
        monkeypatch.setattr(presence, name, value)
    monkeypatch.setattr(locking, "fcntl", None)
    run(tmp_path, "1/3")
    path = announce(tmp_path / "checkpoint", 2, "2/3")
    path.write_text(json.dumps(json.loads(path.read_text()) | {"where": "elsewhere", "host": "node7"}))
    refused = pytest.raises(OutputError, match=r"shard 2/3 \(host node7, process \d+\) still writes into")
    with (
        presence.renewing(path) if runs else contextlib.nullcontext(),
        pytest.warns(
            UserWarning, match=r"shard 2/3 \(host node7, process \d+\) did not say that it has ended"
        ),
        refused if runs else contextlib.nullcontext(),
    ):
        folder(tmp_path, resume=True).check(STUDY)


def test_items_of_a_killed_shard_go_on_from_their_state(tmp_path):
    """By the same shard again, or by the run that gathers; sibling: those of one that runs are left alone."""
    for again in (True, False):
        path, task = tmp_path / str(again), Counting()
        killed(path, "2/3", 4)
        assert results(path) == {1: SUMS[1]} and len(list((path / "checkpoint").glob("shard-*"))) == 1
        assert Shelf(path / "checkpoint").state(4)[0] == {"left": 12345, "sum": 6}
        if again:
            run(path, "2/3", task)
            assert results(path) == {1: SUMS[1], 4: SUMS[4]}
        else:
            with folder(path, resume=True).running(STUDY) as shelf:
                run_part(task, ITEMS, SharedShelf(shelf.folder, 1.0, presence=path / "none"), Screen(True))
                assert results(path) == SUMS
        assert 123456 not in task.begun
        assert list(path.glob("*")) == ([path / "checkpoint"] if again else [])


def test_an_item_of_another_process_is_left_to_it(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(presence, "BEAT", 0.05)
    with folder(tmp_path, "1/1").shared(STUDY) as other:
        assert other.claim(4) and other.claim(4)  # its own claim is no hindrance
        task = Counting()
        run(tmp_path, "2/3", task)
        assert task.begun == [999] and results(tmp_path) == {1: SUMS[1]}
        assert "shard 2/3 has finished 1 of its 2 runs, and another process runs the rest; 1 of" in (
            capsys.readouterr().err
        )
    task = Counting()
    run(tmp_path, "2/3", task)  # it has ended without a result
    assert task.begun == [123456] and results(tmp_path) == {1: SUMS[1], 4: SUMS[4]}


def test_the_first_result_stays_and_one_whose_claim_was_taken_over_stores_nothing(tmp_path):
    with folder(tmp_path, "1/1").shared(STUDY) as slow, folder(tmp_path, "1/1").shared(STUDY) as fast:
        assert slow.claim(0)
        slow.save(0, "early")
        slow.presence.write_text("{}")  # it is taken for dead
        assert fast.claim(0) and fast.state(0) == "early"
        fast.save(0, "later")
        slow.save(0, "slow")
        slow.store(0, "slow")
        assert fast.state(0) == "later" and fast.result(0) is None
        fast.store(0, "fast")
        fast.store(0, "again")
        slow.store(0, "slow")
        assert fast.result(0) == ("fast",) and not fast.claim(0) and not slow.claim(0)


def test_a_process_that_was_taken_for_dead_writes_no_frame_into_the_trajectory_of_another(tmp_path):
    scenes = [hs.lattice_gas(n=8, packing_fraction=0.1, seed=k) for k in range(4)]
    whole = Trajectory()
    with whole.recording(tmp_path):
        for scene in scenes:
            whole.add(scene)
    right = (tmp_path / Trajectory.FILE).read_bytes()
    slow = Trajectory()
    with slow.recording(tmp_path):
        slow.add(scenes[0])
        slow.add(scenes[1])
        fast = Trajectory(written=1)  # from the state saved by the other
        with fast.recording(tmp_path):
            fast.add(scenes[1])
            slow.add(scenes[2])
            for scene in scenes[2:]:
                fast.add(scene)
        slow.add(scenes[3])
    assert (tmp_path / Trajectory.FILE).read_bytes() == right


def test_a_claim_that_is_damaged_or_was_made_to_deceive_falls(tmp_path):
    with folder(tmp_path, "1/1").shared(STUDY) as shelf:
        for number, content in enumerate(
            [b"", b"\xff\xfe", b"../../etc/passwd", b"shard-0001-01234567", b"\0"]
        ):
            (shelf.folder / f"claim-{number:04d}").write_bytes(content)
            assert shelf.claim(number)


def test_a_damaged_result_is_done_again(tmp_path):
    run(tmp_path, "1/3")
    done = tmp_path / "checkpoint" / "done-0003.npz"
    done.write_bytes(done.read_bytes()[:-1])
    task = Counting()
    with pytest.warns(UserWarning, match="done-0003.npz .*computed again"):
        run(tmp_path, "1/3", task)
    assert task.begun == [7] and results(tmp_path)[3] == SUMS[3]


def test_a_file_system_without_hard_links(tmp_path, monkeypatch):
    def none(*_):
        raise OSError("no hard links")

    monkeypatch.setattr("os.link", none)
    for shard in ("1/2", "2/2"):
        run(tmp_path, shard)
    assert results(tmp_path) == SUMS


def test_workers_of_a_shard_claim_what_they_run(tmp_path):
    with folder(tmp_path, "1/2").shared(STUDY) as shelf:
        run_part(math.sqrt, [(k, float(k)) for k in range(6)], shelf, Screen(True), workers=2)
        assert sorted(path.name for path in shelf.folder.glob("claim-*")) == [
            "claim-0000",
            "claim-0002",
            "claim-0004",
        ]
        assert [shelf.result(k) for k in range(6)] == [(0.0,), None, (math.sqrt(2.0),), None, (2.0,), None]
