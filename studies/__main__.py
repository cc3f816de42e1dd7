"""Entry point of the command line, also as `python -m studies`; an interrupt works even during imports."""

import os
import signal

from studies.running import ours as this_process
from studies.running.garbage import collect_rarely


def _leave(*_: object) -> None:
    """Exit at once on an interrupt, also during imports; there is nothing to save yet."""
    os.write(2, b"interrupted\n")
    os._exit(130)


def main() -> None:
    """Load and run the command line, see `studies.cli`."""
    ours = (
        signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )  # and not ignored, as in the background
    if ours:
        signal.signal(signal.SIGINT, _leave)
    this_process.claim()
    collect_rarely()
    from studies.cli import main as run

    try:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:  # in the moment before `run` listens, or after
        _leave()


if __name__ == "__main__":
    main()
