"""The answer of a study in words, from the same numbers as its table."""

from __future__ import annotations

import math
from collections.abc import Sequence

from scipy.special import ndtr

from analysis.statistics import TheoryCheck
from studies.answer import Answer, expected_cell, measured_cell, names_of

__all__ = ["answer_in_words", "over_many"]

FEW = 3  # gases whose numbers are told one by one


def _told(answer: Answer) -> list[TheoryCheck]:
    """Return the main numbers of a gas; where none of them has a theory, also the first that has one."""
    if not answer.numbers:
        return []
    named = () if answer.main is None or isinstance(answer.main, str) else answer.main
    found = [each for each in answer.numbers if each.quantity in named] or [answer.numbers[0]]
    if not any(math.isfinite(each.z) for each in found):
        found += [each for each in answer.numbers if math.isfinite(each.z)][:1]
    return found


def answer_in_words(answers: Sequence[Answer]) -> list[str]:
    """Return the answer in a few sentences: main numbers with error bars, and how far they are from theory.

    Parameters
    ----------
    answers : sequence of Answer
        Of one or more gases.
    """
    told = [_told(answer) for answer in answers]
    if len(answers) <= FEW:
        words = [
            _sentence(f"{where}: " if where else "", numbers)
            for where, numbers in zip(names_of(answers), told, strict=True)
            if numbers
        ]
    else:
        quantities = dict.fromkeys(each.quantity for numbers in told for each in numbers)
        etas = [answer.gas.packing_fraction for answer in answers]
        span = f", packing fractions {min(etas):g} to {max(etas):g}"
        words = []
        for quantity in quantities:
            pairs = zip(names_of(answers), told, strict=True)
            found = [(where, each) for where, own in pairs for each in own if each.quantity == quantity]
            words.append(over_many(quantity, found, f"in {len(found)} gases{span}"))
    return words + _chance([each.z for numbers in told for each in numbers if math.isfinite(each.z)])


def _sentence(where: str, numbers: Sequence[TheoryCheck]) -> str:
    return _capital(where + "; ".join(map(_one, numbers))) + "."


def _capital(text: str) -> str:
    """Return a sentence with a capital, unless it begins with a symbol, as a2 or <l^2>."""
    first = text.split(" ", 1)[0].replace("-", "").rstrip(",:")
    return text[0].upper() + text[1:] if first.isalpha() and len(first) > 1 else text


def _one(found: TheoryCheck) -> str:
    """Return a number, its error bar, its theory and its deviation."""
    text = f"{found.quantity} = {measured_cell(found) or 'not known'}"
    if not math.isfinite(found.z):
        return f"{text}, beside {_expected(found)}" if expected_cell(found) else text
    text += f", {_deviation(found)}"
    return text + ", whose own uncertainty is the larger one" * found.better_than_theory


def _deviation(found: TheoryCheck) -> str:
    """Return how far a number is from its theory."""
    way = "above" if found.z > 0.0 else "below"
    return f"{abs(found.z):.1f} standard errors {way} {_expected(found)}"


def _expected(found: TheoryCheck) -> str:
    """Return what was expected, and by which theory."""
    theory = f"theory ({found.theory})" if found.theory else "the value expected"
    return f"{theory}, {expected_cell(found)}"


def over_many(quantity: str, found: Sequence[tuple[str, TheoryCheck]], span: str) -> str:
    """Return how well a quantity was measured in many gases, and its largest deviation from theory.

    Parameters
    ----------
    quantity : str
        Its name.
    found : sequence of (str, TheoryCheck)
        Its numbers, each with what tells the gas from the others.
    span : str
        Where they are from.
    """
    relative = [abs(each.measured.standard_error / (each.measured.value or math.nan)) for _, each in found]
    text = f"{quantity} {span}"
    if all(map(math.isfinite, relative)):
        text += f", to {100 * max(relative):.1g} % or better (one standard error)"
    compared = [(where, each) for where, each in found if math.isfinite(each.z)]
    if compared:
        where, worst = max(compared, key=lambda pair: abs(pair[1].z))
        text += f". The largest deviation is at {where}: {measured_cell(worst)}, {_deviation(worst)}"
    return _capital(text) + "."


def _chance(deviations: Sequence[float]) -> list[str]:
    """Return how often chance alone makes the largest of some deviations as large."""
    if not deviations:
        return []
    count, largest = len(deviations), max(map(abs, deviations))
    p = -math.expm1(count * math.log1p(-min(2.0 * float(ndtr(-largest)), 1.0 - 1e-16)))
    what = "a deviation" if count == 1 else f"the largest of {count} deviations"
    often = f"{100 * p:.2g} %" if p >= 1e-3 else f"{p:.0e}"
    return [f"By chance alone {what} would be that large in {often} of such studies."]
