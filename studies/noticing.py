"""Warnings of estimators during a study, reworded for its user: the quantity, and the option that helps."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from analysis.series import ShortSeriesWarning

__all__ = ["Notices", "too_short"]

OURS = ("analysis.", "hardspheres.")


@dataclass
class Notices:
    """Warnings collected during a run.

    Attributes
    ----------
    notes : list of str
        Sentences, each once.
    times : float
        How many times longer the run should have been for error bars that can be trusted; 0 where it is long
        enough.
    """

    notes: list[str] = field(default_factory=list)
    times: float = 0.0

    @contextmanager
    def of(self, quantity: str) -> Iterator[None]:
        """Collect warnings of this package's estimators while the context lasts; others pass through.

        Parameters
        ----------
        quantity : str
            What is measured in the context.
        """
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        for warning in caught:
            if not warning.category.__module__.startswith(OURS):
                warnings.warn_explicit(
                    warning.message, warning.category, warning.filename, warning.lineno, source=warning.source
                )
            elif isinstance(warning.message, ShortSeriesWarning):
                self.times = max(self.times, warning.message.times)
            elif (note := f"{quantity}: {warning.message}") not in self.notes:
                self.notes.append(note)


def too_short(times: float, length: float) -> list[str]:
    """Return what to say of a run that is too short by this factor; nothing where it is long enough.

    Parameters
    ----------
    times : float
        As in `Notices`.
    length : float
        Collisions per particle that were measured.
    """
    if times == 0.0:
        return []
    digit = 10.0 ** (math.floor(math.log10(times * length)) - 1)
    needed = digit * math.ceil(times * length / digit)
    said = f"{length:g} collisions per particle are too few for the correlations of this gas"
    return [f"error bars are lower bounds: {said}; ask for --collisions-per-particle {needed:g} or more"]
