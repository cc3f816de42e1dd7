"""Faults, each in a real child process: killed, interrupted, out of disk, robbed of its folder or of its workers."""

import json
import os
import random
import re
import select
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

if sys.platform != "win32":
    import pty

import studies
from studies.running.locking import Lock

from .pages import masked

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="reads /proc, sends POSIX signals"
)

COMMAND = [sys.executable, "-m", "studies"]
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
ALONE = [*THERMALISE, "--workers", "1"]
THERMALISE += ["--workers", "2"]
OFTEN = ["--checkpoint-every", "0"]
HUNG_UP = "hung up, as a terminal does when it is closed"
KEPT = "the same command with --resume continues"


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
    """Every file of a folder but for timings; no folder may be left in it but that of replicas."""
    files = {path.name: path.read_bytes() for path in folder.iterdir() if path.name != "replicas"}
    files["replicas"] = sorted(path.name for path in (folder / "replicas").iterdir())
    files["summary.json"] = json.dumps(without_timings(json.loads(files["summary.json"])))
    files["report.html"] = masked(files["report.html"].decode())
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


def children(pid):
    """Process ids of the children of a process."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == pid:
                found.append(int(entry.name))
        except (OSError, ValueError):
            continue
    return found


def workers_of(pid):
    """Process ids of the workers of a process, and last of the server that they are forks of."""
    (server,) = children(pid)
    return [*children(server), server]


@pytest.mark.usefixtures("heard")
def test_killed_and_interrupted_and_resumed(undisturbed, tmp_path):
    """Killed as soon as there is something to resume; resumed and interrupted; resumed to the end."""
    out, checkpoint = tmp_path / "out", tmp_path / "out" / "checkpoint"
    options = [*PRESSURE, "--out", str(out), *OFTEN]
    run = start(*options)
    wait_for((checkpoint / "running-0001.npz").exists)
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
    wait_for((checkpoint / "running-0000.npz").exists)
    run.send_signal(signal.SIGINT)
    errors = run.communicate(timeout=60)[1]
    assert run.returncode == 130
    assert errors == f"interrupted; what was done is kept in {checkpoint}: {KEPT}\n"
    assert (checkpoint / "done-0001.npz").exists()

    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(PRESSURE)[0]


def test_a_full_disk_is_told_in_a_sentence_and_the_run_goes_on_later(undisturbed, tmp_path):
    """No file may grow beyond 75 kB: the figure does, a result does not."""
    out = tmp_path / "out"
    options = [*PRESSURE, "--out", str(out)]
    code, errors = finish(*options, preexec_fn=lambda: limit_files(75_000))
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


FORKING = """
import json, os, sys
from studies.cli import main
tell = os.fdopen(os.dup(1), "w", buffering=1)
os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
def run(options):
    sys.argv = ["hardspheres", *options]
    try:
        main()
    except SystemExit as end:
        return end.code or 0
    return 0
print(run(json.loads(sys.stdin.readline())), file=tell)
for line in sys.stdin:
    pid = os.fork()
    if pid == 0:
        os._exit(run(json.loads(line)))
    print(pid, file=tell)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), file=tell)
"""


class Forked:
    """Commands in processes of their own, forked from one that has run a first command, and so has all of it loaded."""

    def __init__(self, *first):
        self.server = subprocess.Popen(
            [sys.executable, "-c", FORKING], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
        )
        self._ask(first)
        assert self.code(300) == 0

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.server.stdin.close()
        self.server.wait(timeout=60)

    def _ask(self, options):
        self.server.stdin.write(json.dumps(options).encode() + b"\n")

    def start(self, *options):
        """Start a command and return the id of its process."""
        self._ask(options)
        return int(self.server.stdout.readline())

    def code(self, seconds):
        """Exit code of the command, None if it has not ended after some seconds."""
        ready = select.select([self.server.stdout], [], [], seconds)[0]
        return int(self.server.stdout.readline()) if ready else None


@pytest.mark.slow
def test_killed_at_twenty_random_moments(tmp_path):
    """Moments of the work itself, since nothing is to be loaded. One run is killed and resumed until it is done, then another."""
    random.seed(20)
    options = [*ALONE, "--checkpoint-every", "0.02", "--out"]
    whole, kills, resumed, finished = tmp_path / "whole", 0, 0, 0
    with Forked(*options, str(tmp_path / "first")) as forked:
        began = time.monotonic()
        forked.start(*options, str(whole))
        assert forked.code(300) == 0
        seconds = time.monotonic() - began
        while kills < 20 or not finished:
            out, resume, done = tmp_path / f"out{finished}", [], False
            while not done:
                pid = forked.start(*options, str(out), *resume)
                code = forked.code(random.uniform(0.0, 0.2) * seconds if kills < 20 else 300)
                if code is None:
                    os.kill(pid, signal.SIGKILL)
                    code = forked.code(60)
                    kills += 1
                assert code in (0, -signal.SIGKILL)
                going_on = (out / "checkpoint" / "manifest.json").exists()
                done = not going_on and (out / "summary.json").exists()  # perhaps killed on its way out
                resume = ["--resume"] if going_on else []
                resumed += going_on
            shutil.rmtree(out / "checkpoint", ignore_errors=True)  # without a manifest it counts as none
            assert contents(out) == contents(whole)
            finished += 1
    assert resumed >= 10


@pytest.mark.slow
@pytest.mark.parametrize("victim", ["parent", "worker"])
def test_a_killed_worker_is_told_and_a_killed_parent_takes_its_workers_along(victim, undisturbed, tmp_path):
    out = tmp_path / "out"
    options = [*THERMALISE, "--out", str(out), *OFTEN]
    run = start(*options)
    wait_for((out / "checkpoint" / "running-0006.npz").exists)
    workers = workers_of(run.pid)
    assert len(workers) == 3
    os.kill(run.pid if victim == "parent" else workers[0], signal.SIGKILL)
    errors = run.communicate(timeout=60)[1]
    if victim == "worker":
        assert run.returncode == 2
        assert errors.startswith(
            "error: a worker process was killed, perhaps out of memory; use fewer workers;"
        )
        assert KEPT in errors and "Traceback" not in errors
    wait_for(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers), seconds=20)
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(THERMALISE)[0]


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize(
    ("number", "code", "word", "to_all"),
    [
        pytest.param(signal.SIGINT, 130, "interrupted", True, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, 143, "terminated", False, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, 143, "terminated", True, marks=pytest.mark.long),
        pytest.param(signal.SIGHUP, 129, HUNG_UP, True, marks=pytest.mark.slow),
    ],
)
def test_workers_save_what_they_have_before_they_end(number, code, word, to_all, undisturbed, tmp_path):
    """At an interval of one minute, so that only the signal makes them save."""
    out = tmp_path / "out"
    options = [*THERMALISE, "--out", str(out)]
    run = start(*options)
    trajectory = out / "checkpoint" / "trajectory.xyz"
    wait_for(lambda: trajectory.exists() and trajectory.stat().st_size > 0)  # that run is under way
    workers = workers_of(run.pid)
    if to_all:  # as a terminal does, or a batch system
        os.killpg(run.pid, number)
    else:
        run.send_signal(number)
    errors = run.communicate(timeout=60)[1]
    assert run.returncode == code
    assert errors == f"{word}; what was done is kept in {out / 'checkpoint'}: {KEPT}\n"
    assert (out / "checkpoint" / "running-0006.npz").exists()
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(THERMALISE)[0]


@pytest.mark.slow
def test_three_shards_two_of_them_at_once_one_killed(undisturbed, tmp_path):
    """The one that writes the trajectory, in its middle: meanwhile no other run may begin; then all is gathered."""
    out, checkpoint = tmp_path / "out", tmp_path / "out" / "checkpoint"
    options = [*ALONE, "--out", str(out)]
    first, second = (start(*options, *OFTEN, "--shard", f"{k}/3") for k in (1, 2))
    wait_for((checkpoint / "running-0006.npz").exists)
    first.send_signal(signal.SIGSTOP)
    wait_for((checkpoint / "claim-0005").exists)  # the other goes on, however late it came
    code, errors = finish(*options, "--resume")
    assert code == 2 and errors.count("\n") == 1
    assert f"process {first.pid}) still writes into {out}; wait until it has ended" in errors
    first.kill()
    first.communicate()
    assert not (checkpoint / "done-0006.npz").exists()
    _, errors = second.communicate(timeout=300)
    assert second.returncode == 0 and errors == ""
    code, errors = finish(*options, "--shard", "3/3")
    assert code == 0, errors
    done = sorted(int(path.stem[5:]) for path in checkpoint.glob("done-*"))
    assert done == [1, 2, 4, 5] and not (out / "summary.json").exists()
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(ALONE)[0]


@pytest.mark.slow
@pytest.mark.usefixtures("heard")
def test_shards_that_start_at_once_and_one_that_is_interrupted(undisturbed, tmp_path):
    out = tmp_path / "out"
    options = [*ALONE, "--out", str(out)]
    shards = [start(*options, *OFTEN, "--shard", f"{k}/3") for k in (1, 2, 3)]
    wait_for((out / "checkpoint" / "claim-0006").exists)
    shards[0].send_signal(signal.SIGTERM)
    errors = [shard.communicate(timeout=300)[1] for shard in shards]
    assert [shard.returncode for shard in shards] == [143, 0, 0] and errors[1:] == ["", ""]
    kept = f"what was done is kept in {out / 'checkpoint'}: the same command goes on, and so does"
    assert errors[0].startswith(f"terminated; {kept}") and errors[0].count("\n") == 1
    code, errors = finish(*options, "--shard", "1/3")
    assert code == 0, errors
    assert len(list((out / "checkpoint").glob("done-*"))) == 7
    code, errors = finish(*options, "--resume")
    assert code == 0, errors
    assert contents(out) == undisturbed(ALONE)[0]


@pytest.mark.slow
def test_the_array_script_of_the_readme(tmp_path):
    """As the batch system runs it, but smaller: three of its tasks, and the run that gathers."""
    text = (Path(studies.__file__).parent / "README.md").read_text(encoding="utf-8")
    (script,) = re.findall(r"^```bash\n(#!/bin/bash\n.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert len(script.splitlines()) == 6
    for large, small in (
        ("--n 4000", "--n 60"),
        ("--replicas 160", "--replicas 2"),
        ("--workers 8", "--workers 1"),
    ):
        assert large in script
        script = script.replace(large, small)
    (tmp_path / "array.sh").write_text(script.replace("/20", "/3").replace("/scratch/$USER", str(tmp_path)))
    known = os.environ | {"PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    for task in ("2", "3", "1"):
        environment = known | {"SLURM_ARRAY_TASK_ID": task}
        done = subprocess.run(
            ["bash", tmp_path / "array.sh"], env=environment, capture_output=True, text=True, check=True
        )
        assert f"shard {task}/3 has finished its " in done.stdout
    gathering = (tmp_path / "array.sh").read_text().replace("--shard $SLURM_ARRAY_TASK_ID/3", "--resume")
    subprocess.run(["bash", "-c", gathering], env=known, check=True, capture_output=True)
    assert (tmp_path / "pressure" / "summary.json").exists()


SENDING = """
import signal, sys
import studies.cli as cli
number, ignored = map(int, sys.argv[1:])
if ignored:
    signal.signal(number, signal.SIG_IGN)
def run():
    try:
        signal.raise_signal(number)
    except BaseException as error:
        error.add_note("a note")
        raise
cli.app = run
cli.main()
"""


@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize(
    ("number", "word"),
    [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated"), (signal.SIGHUP, HUNG_UP)],
)
def test_signals_are_told_in_a_sentence_and_those_that_are_ignored_stay_so(number, word):
    """As under nohup. Standard error may have gone with the terminal."""
    command = [sys.executable, "-c", SENDING, str(int(number))]
    done = subprocess.run([*command, "0"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, done.stdout) == (128 + number, f"{word}; a note\n", "")
    done = subprocess.run([*command, "1"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "")
    with open("/dev/full", "w") as full:
        done = subprocess.run([*command, "0"], stderr=full, check=False)
    assert done.returncode == 128 + number


WAITING = """
import fcntl, sys, termios, time
import studies.cli as cli
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
def run():
    print("ready", flush=True)
    try:
        time.sleep(60)
    finally:
        print("as a progress bar does", file=sys.stderr, flush=True)
cli.app = run
cli.main()
"""


@pytest.mark.usefixtures("heard")
def test_a_terminal_that_is_closed_under_a_run():
    """What is written on the way out goes nowhere, and does not become another error."""
    terminal, inside = pty.openpty()
    run = subprocess.Popen(
        [sys.executable, "-c", WAITING],
        stdin=inside,
        stdout=inside,
        stderr=inside,
        start_new_session=True,
    )
    os.close(inside)
    assert b"ready" in os.read(terminal, 100)
    os.close(terminal)
    assert run.wait(timeout=30) == 129


@pytest.mark.slow
def test_a_folder_that_vanishes_or_cannot_be_written(tmp_path):
    out = tmp_path / "out"
    run = start(*PRESSURE, "--out", str(out), *OFTEN)
    wait_for((out / "checkpoint" / "running-0001.npz").exists)
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
