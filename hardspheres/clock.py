"""Time as two numbers, whole epochs and the time within one, so that its resolution never degrades."""

import math

__all__ = ["FOREVER", "carried", "recounted"]

FOREVER = 2**62  # no clock or counter reaches this


def carried(epoch: int, moment: float, length: float) -> tuple[int, float]:
    """Bring the time within an epoch of this length into its range; exact."""
    whole = math.floor(moment / length)
    return epoch + whole, moment - whole * length


def recounted(epoch: int, moment: float, before: float, length: float) -> tuple[int, float]:
    """Return the same time in epochs of another length, a power of two times that before.

    Parameters
    ----------
    epoch, moment : int and float
        Whole epochs, and the time within this one.
    before, length : float
        Lengths of the old and of the new epochs.

    Returns
    -------
    epoch, moment : int and float
        Exact in shorter epochs; rounded, as any time within them is, in longer ones.
    """
    if length <= before:
        return carried(epoch * round(before / length), moment, length)
    whole, rest = divmod(epoch, round(length / before))
    return carried(whole, moment + rest * before, length)
