"""`python -m hardspheres`: the console script, found by its entry point, without an import of `studies`."""

import sys
from importlib.metadata import entry_points


def main() -> None:
    """Run the console script `hardspheres`."""
    for script in entry_points(group="console_scripts", name="hardspheres"):
        script.load()()
        return
    sys.exit("error: the command line is not installed; install this package with pip")


if __name__ == "__main__":
    main()
