"""Sums whose terms may come in any order: a whole number of units and a fraction, both exact.

A sum is W + F in a unit that is a power of two: W a whole number, F one of the 2^47 multiples of 2^-47 in
[-1/2, 1/2). A term is rounded once, to a multiple of 2^-47 units, and everything after that is addition of
integers, which float64 does exactly. The two numbers of a sum are the only ones for its value, so the same
terms give the same bits in any order, and in any division into partial sums that are merged later.

No sum wraps. One of 2^53 units or more would be rounded as sums of float64 are, and then its order matters
again in the last digits; `hardspheres.tally_units` keeps away from there. All arithmetic is + and -, so these
functions take numbers, arrays or vectors of a kernel. They must not be compiled with fast arithmetic.
"""

import math
from typing import Any

import numpy as np

__all__ = ["accumulated", "add_sums", "add_to", "are_sums", "merged", "split"]

FRACTION_BITS = 47
# Adding and taking off 1.5 * 2^52 rounds to whole numbers; 1.5 * 2^52 * 2^-47, to multiples of 2^-47.
WHOLE = 1.5 * 2.0**52
FINE = math.ldexp(WHOLE, -FRACTION_BITS)
# Less than the spacing of fractions: a fraction of just 1/2 is rounded up, whatever the parity of the rest.
LESS_THAN_ANY = math.ldexp(1.0, -FRACTION_BITS - 2)


def split(term: Any) -> Any:
    """Return whole and fraction of a term below 2^51 units, rounded once; larger ones are rounded more."""
    whole = (term + WHOLE) - WHOLE
    return whole, ((term - whole) + FINE) - FINE


def merged(whole: Any, fraction: Any, more: Any, more_fraction: Any) -> Any:
    """Return the sum of two sums, or of a sum and a term, exactly."""
    fraction = fraction + more_fraction
    carry = ((fraction + LESS_THAN_ANY) + WHOLE) - WHOLE
    return whole + (more + carry), fraction - carry


def add_to(sums: Any, first: int, gap: int, terms: Any) -> None:
    """Add terms to the sums from `first` on, whose fractions are `gap` behind their whole numbers."""
    for k, term in enumerate(terms, first):
        sums[k], sums[k + gap] = merged(sums[k], sums[k + gap], *split(term))


def add_sums(sums: Any, more: Any) -> None:
    """Add sums to sums, both arrays of shape (..., 2, n): partial sums give the bits of the whole."""
    sums[..., 0, :], sums[..., 1, :] = merged(
        sums[..., 0, :], sums[..., 1, :], more[..., 0, :], more[..., 1, :]
    )


def are_sums(sums: Any) -> bool:
    """Whether all, of shape (..., 2, n), are whole numbers and fractions as sums have them."""
    whole, fraction = sums[..., 0, :], sums[..., 1, :]
    carry, kept = merged(0.0, 0.0, *split(fraction))
    return bool(np.all((np.rint(whole) == whole) & (carry == 0.0) & (kept == fraction)))


def accumulated(value: Any, rest: Any, more: Any, more_rest: Any) -> Any:
    """Return the sum of two numbers of twice the digits of float64, each in two parts.

    To 2^-104 of the larger, for what is added in one order only. Source: Knuth's two-sum (The Art of
    Computer Programming 2, 4.2.2).
    """
    total = value + more
    of_more = total - value
    rest = rest + (more_rest + ((value - (total - of_more)) + (more - of_more)))
    value = total + rest
    return value, rest - (value - total)
