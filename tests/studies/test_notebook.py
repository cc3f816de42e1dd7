"""Notebooks: results as plain text, one output that is replaced in place for what runs, and no line of a bar kept."""

import builtins
import os
import subprocess
import sys
import types
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.spawn import get_preparation_data

import pytest

from studies import notebook
from studies.exits import run_program
from studies.report import Screen, Summary
from studies.running import ensemble
from studies.running.ensemble import run_replicas


class ZMQInteractiveShell:
    """What rich takes for the shell of a notebook."""


class Output:
    """A display of IPython: what it showed, one after another."""

    def __init__(self, content):
        self.states = [content]

    def update(self, content, raw):
        assert raw and set(content) == {"text/plain", "text/html"}
        self.states.append(content)


@pytest.fixture
def kernel(monkeypatch):
    """A notebook's kernel without one: outputs by display, and the environment that ipykernel makes."""
    outputs = []

    def display(content, raw, display_id):
        assert raw and display_id is True
        outputs.append(Output(content))
        return outputs[-1]

    module = types.ModuleType("IPython.display")
    module.display = display
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    monkeypatch.setattr(builtins, "get_ipython", ZMQInteractiveShell, raising=False)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("JPY_PARENT_PID", "1")
    return outputs


def show(screen):
    """All that a screen can do."""
    screen.note("a note")
    with screen.working("drawing <b>"):
        pass
    with screen.progress("runs", 1000) as advance:
        for _ in range(1000):
            advance()
    screen.say("word " * 40)
    screen.table("title", ["x"], [["1"], ["2"]])


def test_a_notebook_gets_text_and_outputs_that_are_emptied(kernel, capsys):
    """No escape sequences, nothing that looks like a failure, lines that need no breaking. Sibling: no notebook, no outputs."""
    show(Screen())
    told = capsys.readouterr()
    assert told.err == "" and "\x1b" not in told.out
    lines = told.out.rstrip("\n").split("\n")
    assert lines[0] == "a note" and lines[-3:] == ["x", "1", "2"] and 90 < max(map(len, lines)) <= 100
    drawing, runs = kernel
    assert [state["text/plain"] for state in drawing.states] == ["drawing <b> ...", ""]
    assert drawing.states[0]["text/html"] == "drawing &lt;b&gt; ..."
    assert runs.states[0]["text/plain"] == "runs 0/1000"
    assert set(runs.states[-1].values()) == {""}


def test_without_a_notebook_nothing_is_displayed(capsys):
    show(Screen())
    told = capsys.readouterr()
    assert told.err == "a note\n" and told.out.startswith("word " * 39)


def test_json_keeps_standard_output_in_a_notebook_too(kernel, capsys):
    show(Screen(json_output=True))
    told = capsys.readouterr()
    assert told.out == "" and told.err.startswith("a note\n")


def test_a_bar_is_replaced_four_times_a_second_however_many_steps(kernel, monkeypatch):
    """A clock of 10 ms a step. Sibling: 1 s a step, where each is shown."""
    for tick, states in ((0.01, 1 + 1000 * 0.01 / notebook.OFTEN + 1), (1.0, 1 + 1000 + 1)):
        clock = iter(range(10_000))
        monkeypatch.setattr(notebook.time, "monotonic", lambda clock=clock, tick=tick: next(clock) * tick)
        kernel.clear()
        with Screen().progress("runs", 1000) as advance:
            for _ in range(1000):
                advance()
        (bar,) = kernel
        assert len(bar.states) == pytest.approx(states, abs=1)
        assert bar.states[-2]["text/plain"] == "runs 1000/1000, about 0:00:00 left"
        assert '<progress value="1000" max="1000"></progress>' in bar.states[-2]["text/html"]


def test_an_output_is_emptied_after_a_failure(kernel):
    with pytest.raises(KeyError), Screen().progress("runs", 2):
        raise KeyError
    assert kernel[0].states[-1]["text/plain"] == ""


@pytest.mark.parametrize("of_a_notebook", [True, False])
def test_a_command_that_a_notebook_started_draws_no_bar(of_a_notebook, monkeypatch, capsys):
    """`!hardspheres ...` finds a terminal, whose every state the notebook would keep. Sibling: a person's terminal."""
    monkeypatch.delenv("JPY_PARENT_PID", raising=False)
    if of_a_notebook:
        monkeypatch.setenv("JPY_PARENT_PID", "1")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    screen = Screen()
    with screen.working("drawing"), screen.progress("runs", 2) as advance:
        advance()
    assert ("runs" in capsys.readouterr().err) is not of_a_notebook


def test_a_command_that_a_notebook_started_draws_its_figures(monkeypatch):
    """IPython names a backend of matplotlib that need not be installed where the command is."""
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    run_program(lambda: None)
    assert os.environ["MPLBACKEND"] == "agg"


def in_a_cell(monkeypatch, **names):
    """Make the main module that of a notebook, with a function that is defined there."""
    main = types.ModuleType("__main__")
    main.square = types.FunctionType((lambda x: x * x).__code__, {}, "square")
    main.square.__module__, main.square.__qualname__ = "__main__", "square"
    vars(main).update(names)
    monkeypatch.setitem(sys.modules, "__main__", main)
    return main.square


def test_what_a_cell_defines_runs_without_workers(monkeypatch):
    """Workers cannot import it; a sentence says so. Sibling: a function of a module, which they can."""
    square, notes = in_a_cell(monkeypatch), []
    with monkeypatch.context() as patch:
        patch.setattr(ensemble, "worker_processes", None)
        assert run_replicas(square, [1, 2, 3], workers=2, note=notes.append) == [1, 4, 9]
        with pytest.warns(UserWarning, match="cannot import what is defined in a notebook or at a prompt"):
            run_replicas(square, [1, 2, 3], workers=2)
        with pytest.raises(TypeError, match="NoneType"):
            run_replicas(abs, [1, 2, 3], workers=2, note=notes.append)
    assert notes == [ensemble.NOT_IN_A_FILE]


@pytest.mark.parametrize(("task", "imported"), [(abs, False), ("square", True)])
def test_workers_import_the_main_module_only_where_it_defines_their_work(task, imported, monkeypatch):
    """What worker processes are told, at the moment when they start; sibling: a task of the script's own."""
    main = sys.modules["__main__"]
    square = in_a_cell(monkeypatch, __file__=__file__)
    script, told = sys.modules["__main__"], []

    class Pool(ThreadPoolExecutor):
        def submit(self, *work):
            told.append(get_preparation_data("worker"))
            return super().submit(*work)

    monkeypatch.setattr(ensemble, "worker_processes", Pool)
    assert run_replicas(square if task == "square" else task, [1, 2], workers=2)[0] == 1
    assert [("init_main_from_path" in each) for each in told] == [imported] * 2
    assert sys.modules["__main__"] is script is not main


SCRIPT = """
from studies.running.ensemble import run_replicas
print("once")
def square(x): return x * x
print(run_replicas({task}, [-1, -2], workers=2))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("task", "runs"), [("abs", True), ("square", False)])
def test_workers_do_not_run_a_script_once_more(task, runs, tmp_path):
    """They need no `if __name__ == "__main__":`. Sibling: they do where the script defines their work, and a sentence says so."""
    (tmp_path / "script.py").write_text(SCRIPT.format(task=task))
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=100, check=False)
    assert (done.returncode == 0) is runs
    if runs:
        assert done.stdout == "once\n[1, 2]\n" and done.stderr == ""
    else:
        assert 'must start them under `if __name__ == "__main__":`' in done.stderr


def test_a_summary_is_shown_in_a_line():
    """Sibling: the dict that it is, with all its entries."""
    content = {
        "study": "pressure",
        "seed": 1,
        "collisions": 1000,
        "states": [{"curve": list(range(1000))}] * 2,
        "checks": {"passed": False},
    }
    text = repr(Summary(content))
    assert text.startswith("<Summary of pressure, seed 1: 2 gases, 1000 collisions, checks FAILED; a dict of")
    assert len(text) < 150 and Summary(content) == content
