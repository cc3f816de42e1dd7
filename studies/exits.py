"""How a program ends: its exit code, and one sentence for the person who ran it.

Exit codes: 0 done, 1 a check failed, 2 bad input or output that cannot be written, 129 hung up, 130
interrupted, 143 terminated.
"""

from __future__ import annotations

import os
import shutil
import signal
import sys
from collections.abc import Callable
from typing import NoReturn

from hardspheres.errors import HardSpheresError
from studies.layout import wrapped
from studies.running.stopping import STOPPING

__all__ = ["run_program"]

ENDED = {129: "hung up, as a terminal does when it is closed", 130: "interrupted", 143: "terminated"}


def run_program(program: Callable[[], object]) -> None:
    """Run a command or a group of commands, and exit with its code."""
    os.environ["MPLBACKEND"] = "agg"  # a notebook that runs `!hardspheres` names one that may be missing here
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
            signal.signal(number, _ended)
    try:
        program()
    except HardSpheresError as error:
        _leave(2, f"error: {error}{_notes(error)}")
    except MemoryError as error:
        _leave(2, f"error: there is not enough memory ({error}); ask for fewer particles{_notes(error)}")
    except KeyboardInterrupt as error:
        _leave(130, f"{ENDED[130]}{_notes(error)}")
    except SystemExit as error:
        if error.code not in ENDED:
            raise
        _leave(int(error.code), f"{ENDED[error.code]}{_notes(error)}")


def _leave(code: int, sentence: str) -> NoReturn:
    """Print the reason, wrapped to the terminal if there still is one, and exit, whatever signals follow."""
    for number in STOPPING:
        signal.signal(number, signal.SIG_IGN)
    width = shutil.get_terminal_size().columns if sys.stderr.isatty() else None
    try:
        print("\n".join(wrapped(sentence, width)), file=sys.stderr, flush=True)
    except OSError:  # a terminal that was closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    raise SystemExit(code) from None


def _notes(error: BaseException | None) -> str:
    """Return the notes added to an error and to the errors that caused it."""
    if error is None:
        return ""
    own = "".join(f"; {note}" for note in getattr(error, "__notes__", ()))
    return own or _notes(error.__cause__ or error.__context__)


def _ended(number: int, _: object) -> NoReturn:
    for stream in (
        1,
        2,
    ):  # the terminal may be closed: writing to it on the way out would raise another error
        try:
            os.write(stream, b"")
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    raise SystemExit(128 + number)
