"""`hardspheres analyse`: any trajectory beside equilibrium."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from studies.analyse.answer import answer_of
from studies.analyse.findings import findings
from studies.analyse.gas_in_file import GasInFile
from studies.analyse.sentences import legend
from studies.answer import curve_files, heading, marks_of, sections, tidy, write_tables
from studies.file_options import AboutAFile
from studies.options import option
from studies.page.write import Report, write_page
from studies.report import OutputFolder, Screen, figure_style, seconds_taken
from studies.running.ownership import REPORT, SUMMARY

__all__ = ["Analyse"]


@dataclass(frozen=True, kw_only=True)
class Analyse(AboutAFile):
    """A table of what the velocities and positions in a file say."""

    name = "analyse"
    question = "What do the velocities and positions in a file say?"
    explanation = """
    Measures the temperature of each species and along each axis, speeds and velocity components beside
    Maxwell and Boltzmann's law, momentum, drift, and g(r) with its contact value where radii are known.
    FILE is a structure or a trajectory: .gsd, or of any program that ASE reads. Frames may be close together:
    the error bars allow for it. A gas that deviates from equilibrium is a result, with exit code 0.
    """
    files = (
        "analysis.csv",
        "frames.csv",
        "speeds.csv",
        "components.csv",
        "pair_distribution.csv",
        "analysis.png",
    )
    reports = True
    resumable = False

    file: str = option("", "Structure or trajectory.", argument=True, metavar="FILE")

    @property
    def which(self) -> str:
        """The name of the file."""
        return Path(self.file).stem

    def conduct(self, out: OutputFolder, screen: Screen) -> tuple[dict[str, Any], bool]:
        """Read the file, print what was found and write it."""
        began = time.perf_counter()
        out.check(self, resumable=False)
        with screen.working(f"reading {self.file}"):
            found = findings(GasInFile(self.file, self.reading()))
        read = time.perf_counter()
        with screen.working("testing and drawing"), figure_style():
            answer = answer_of(found)
            from studies.figures.analyse import figure

            subject, drawn = heading([answer], None), figure(answer)
        told = [*legend(found), *(marks_of([answer]) if answer.numbers else [])]
        out.create()
        out.write_csv("analysis.csv", tidy([answer]))
        curves = curve_files([answer])
        if "frames" in curves:
            out.write_csv("frames.csv", curves["frames"])
            out.write_csv("speeds.csv", curves["speeds"])
            out.write_csv("components.csv", curves["components"])
        if "pair_distribution" in curves:
            out.write_csv("pair_distribution.csv", curves["pair_distribution"])
        out.save_figure("analysis.png", drawn, subject)
        summary: dict[str, Any] = {
            **self.made(),
            "frames": found.gas.n_frames,
            "n": found.gas.n,
            "dim": found.gas.dim,
            "states": [answer.summary()],
            "files": sorted({*out.files, REPORT, SUMMARY}),
            "seconds": seconds_taken(began, began, read, work="reading"),
        }
        page = Report(
            name=self.name,
            subject=subject,
            question=self.asked,
            answer=[answer.verdict],
            notes=answer.notes,
            figures={"analysis": drawn},
            sections=sections([answer], None),
            legend=told,
            summary=summary,
        )
        write_page(out, page)
        out.write_json(SUMMARY, summary)
        write_tables(screen, [answer], None)
        for sentence in [*told, *answer.notes, answer.verdict]:
            screen.say(sentence)
        screen.say(f"written to {out.path}: {', '.join(summary['files'])}")
        return summary, True
