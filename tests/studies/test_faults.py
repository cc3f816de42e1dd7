"""Faults, each in a real child process: killed, interrupted, out of disk, robbed of its folder or of its workers."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from studies.locking import Lock

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="reads /proc, sends POSIX signals"
)

COMMAND = [sys.executable, "-m", "studies.cli"]
PRESSURE = ["pressure", "--packing-fractions", "0.3", "--n", "200", "--replicas", "2"]
PRESSURE += ["--collisions-per-particle", "2000", "--workers", "1"]
THERMALISE = [
    "thermalise",
    "--n",
    "4000",
    "--replicas",
    "6",
    "--collisions-per-particle",
    "60",
    "--frames",
    "41",
]
THERMALISE += ["--workers", "2"]
OFTEN = ["--checkpoint-every", "0"]
KEPT = "the same command with --resume goes on"


def start(*options, **more):
    return subprocess.Popen(
        [*COMMAND, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        **more,
    )


def finish(*options, **more):
    """Exit code and standard error of a command."""
    run = start(*options, **more)
    errors = run.communicate(timeout=300)[1]
    return run.returncode, errors


def wait_for(condition, seconds=120):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def without_timings(value):
    if isinstance(value, dict):
        return {key: without_timings(entry) for key, entry in value.items() if "second" not in key}
    return [without_timings(entry) for entry in value] if isinstance(value, list) else value


def contents(folder):
    """Every file of a folder but for timings; no folder may be left in it."""
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    files["summary.json"] = json.dumps(without_timings(json.loads(files["summary.json"])))
    return files


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """What a command leaves, and the seconds that it takes, by its options."""
    known = {}

    def of(options):
        if tuple(options) not in known:
            out, began = tmp_path_factory.mktemp("undisturbed"), time.monotonic()
            code, errors = finish(*options, "--out", str(out))
            assert code == 0, errors
            known[tuple(options)] = contents(out), time.monotonic() - began
        return known[tuple(options)]

    return of


def workers_of(pid):
    """Process ids of the workers of a process."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid and "spawn_main" in (entry / "cmdline").read_text():
                found.append(int(entry.name))
        except (OSError, ValueError):
            continue
    return found


def test_killed_and_interrupted_and_resumed(undisturbed, tmp_path):
    """Killed as soon as there is something to resume; resumed and interrupted; resumed to the end."""
    out, checkpoint = tmp_path / "out", tmp_path / "out" / "checkpoint"
    options = [*PRESSURE, "--out", str(out), *OFTEN]
    run = start(*options)
    wait_for((checkpoint / "running-0000.npz").exists)
    run.send_signal(signal.SIGSTOP)  # so that it is still there when the second has started
    assert not Lock(checkpoint / "lock").acquire()
    code, errors = finish(*options, "--resume")  # a second run at the same time
    assert (
        code == 2
        and errors
        == f"error: another run writes into {out}; give another folder with --out, or wait for it\n"
    )
    run.kill()
    run.communicate()
    assert run.returncode == -signal.SIGKILL and not (out / "summary.json").exists()

    run = start(*options, "--resume")
    wait_for((checkpoint / "running-0001.npz").exists)
    run.send_signal(signal.SIGINT)
    errors = run.communicate(timeout=60)[1]
    assert run.returncode == 130
    assert errors == f"interrupted; what was done is kept in {checkpoint}: {KEPT}\n"
    assert (checkpoint / "done-0000.npz").exists()

    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(PRESSURE)[0]


def test_a_full_disk_is_told_in_a_sentence_and_the_run_goes_on_later(undisturbed, tmp_path):
    """No file may grow beyond 20 kB: the figure does."""
    out = tmp_path / "out"
    options = [*PRESSURE, "--out", str(out)]
    code, errors = finish(*options, preexec_fn=limit_files)
    assert code == 2 and errors.count("\n") == 1 and KEPT in errors
    assert "equation_of_state.png cannot be written: File too large" in errors
    assert sorted(path.name for path in out.iterdir()) == ["checkpoint", "equation_of_state.csv"]
    names = sorted(path.name for path in (out / "checkpoint").iterdir())
    assert names == ["done-0000.npz", "done-0001.npz", "lock", "manifest.json"]
    assert (out / "equation_of_state.csv").read_bytes() == undisturbed(PRESSURE)[0]["equation_of_state.csv"]
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(PRESSURE)[0]


def limit_files(size=20_000):
    import resource

    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.slow
def test_a_disk_that_is_full_in_the_middle_of_a_run(undisturbed, tmp_path):
    """The trajectory does not fit, nor the first state of the second replica; whichever is told first."""
    out = tmp_path / "out"
    code, errors = finish(*THERMALISE, "--out", str(out), *OFTEN, preexec_fn=limit_files)
    assert code == 2 and "cannot be written: File too large" in errors, errors
    assert KEPT in errors and errors.count("\n") == 1
    assert sorted(path.name for path in out.iterdir()) == ["checkpoint"]
    assert not [path for path in (out / "checkpoint").iterdir() if path.name.startswith(".")]
    code, errors = finish(*THERMALISE, "--out", str(out), "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(THERMALISE)[0]


@pytest.mark.slow
def test_killed_at_twenty_random_moments(undisturbed, tmp_path):
    """With two workers and a trajectory. A run that ends before its next kill is compared, and another begins."""
    random.seed(20)
    expected, seconds = undisturbed(THERMALISE)
    kills, resumed, finished = 0, 0, 0
    while kills < 20 or not finished:
        out, resume = tmp_path / f"out{finished}", []
        while True:
            run = start(*THERMALISE, "--out", str(out), "--checkpoint-every", "0.05", *resume)
            try:
                delay = random.uniform(0.3, 0.9) * seconds if kills < 20 else 300
                errors = run.communicate(timeout=delay)[1]
                assert run.returncode == 0, errors
                break
            except subprocess.TimeoutExpired:
                run.kill()
                run.communicate()
                kills += 1
            if (out / "checkpoint" / "manifest.json").exists():
                resume, resumed = ["--resume"], resumed + 1
            elif (out / "summary.json").exists():  # killed on its way out
                break
            else:
                resume = []
        assert contents(out) == expected
        finished += 1
    assert resumed >= 5


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["parent", "worker"])
def test_a_killed_worker_is_told_and_a_killed_parent_takes_its_workers_along(victim, undisturbed, tmp_path):
    out = tmp_path / "out"
    options = [*THERMALISE, "--out", str(out), *OFTEN]
    run = start(*options)
    wait_for((out / "checkpoint" / "running-0000.npz").exists)
    workers = workers_of(run.pid)
    assert len(workers) == 2
    os.kill(run.pid if victim == "parent" else workers[0], signal.SIGKILL)
    errors = run.communicate(timeout=60)[1]
    if victim == "worker":
        assert run.returncode == 2
        assert errors.startswith(
            "error: a worker process was killed, perhaps for want of memory; use fewer workers;"
        )
        assert KEPT in errors and "Traceback" not in errors
    wait_for(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), seconds=20)
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(THERMALISE)[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_workers_save_what_they_have_before_they_end(number, code, word, undisturbed, tmp_path):
    """At an interval of one minute, so that only the signal makes them save."""
    out = tmp_path / "out"
    options = [*THERMALISE, "--out", str(out)]
    run = start(*options)
    wait_for((out / "checkpoint" / "trajectory.xyz").exists)
    workers = workers_of(run.pid)
    run.send_signal(number)
    errors = run.communicate(timeout=60)[1]
    assert run.returncode == code
    assert errors == f"{word}; what was done is kept in {out / 'checkpoint'}: {KEPT}\n"
    assert (out / "checkpoint" / "running-0000.npz").exists()
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(THERMALISE)[0]


@pytest.mark.slow
def test_a_folder_that_vanishes_or_cannot_be_written(tmp_path):
    out = tmp_path / "out"
    run = start(*PRESSURE, "--out", str(out), *OFTEN)
    wait_for((out / "checkpoint" / "running-0000.npz").exists)
    while out.exists():
        shutil.rmtree(out, ignore_errors=True)
    errors = run.communicate(timeout=60)[1]
    assert run.returncode == 2 and errors.startswith("error: ") and "cannot be written" in errors
    assert errors.count("\n") == 1 and not out.exists()
    code, errors = finish(*PRESSURE, "--out", "/proc/out")
    assert code == 2 and errors.startswith("error: /proc") and errors.count("\n") == 1


@pytest.mark.slow
def test_a_small_disk(undisturbed, tmp_path):
    """A file system of 48 kB; mounting it needs the right to."""
    small = tmp_path / "small"
    small.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=48k", "tmpfs", str(small)]
    if not shutil.which("mount") or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no right to mount a file system")
    try:
        options = [*PRESSURE, "--out", str(small / "out"), *OFTEN]
        code, errors = finish(*options)
        assert code == 2 and "No space left on device" in errors and errors.count("\n") == 1, errors
        hidden = [path for path in small.rglob(".*") if path.is_file()]
        assert not hidden
        subprocess.run([*mount[:4], "remount,size=4m", *mount[5:]], check=True)
        code, errors = finish(*options, "--resume")
        assert code == 0, errors
        assert contents(small / "out") == undisturbed(PRESSURE)[0]
    finally:
        subprocess.run(["umount", str(small)], check=False)
