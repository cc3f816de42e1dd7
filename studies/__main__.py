"""Where the command line begins, also as `python -m studies`: an interrupt is answered even before anything is loaded."""

import sys


def main() -> None:
    """Load and run the command line, see `studies.cli`."""
    try:
        from studies.cli import main as run
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(130) from None
    run()


if __name__ == "__main__":
    main()
