"""Analysis of any trajectory.

Files in reading order: `gas_in_file` (frames of a file, and what it lacks), `findings` (what is measured),
`answer` (numbers and curves), `sentences` (what they mean), `command` (`hardspheres analyse`).
"""

from studies.analyse.answer import Analysis, answer_of
from studies.analyse.findings import Findings, findings
from studies.analyse.gas_in_file import GasInFile

__all__ = ["Analysis", "Findings", "GasInFile", "answer_of", "findings"]
