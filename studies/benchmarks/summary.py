"""What a benchmark of many gases leaves behind beside its table: summary.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import hardspheres as hs
from studies.report import OutputFolder, Screen, machine, today
from studies.running.ownership import SUMMARY

__all__ = ["write_summary"]


def write_summary(
    out: OutputFolder,
    screen: Screen,
    content: Mapping[str, Any],
    made: Mapping[str, Any] | None = None,
    failures: Sequence[str] = (),
) -> dict[str, Any]:
    """Write the summary, say what was written where, and return the summary.

    Parameters
    ----------
    out : OutputFolder
        Where the files go; its table is there.
    screen : Screen
        Where that is said.
    content : mapping
        What the summary tells of this benchmark.
    made : mapping, optional
        What else made it, of `Program.made`.
    failures : sequence of str
        What did not hold, a sentence each.
    """
    summary: dict[str, Any] = {
        "study": "bench",
        "date": today(),
        "version": hs.__version__,
        **content,
        "checks": {"passed": not failures, "failures": list(failures)},
        "machine": machine(),
        **(made or {}),
        "files": sorted({*out.files, SUMMARY}),
    }
    out.write_json(SUMMARY, summary)
    screen.say(f"written to {out.path}: {', '.join(out.files)}")
    return summary
