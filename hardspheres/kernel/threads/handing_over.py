"""The sums of all threads become those of the first: exact, in any order (`hardspheres.sums`)."""

from hardspheres import sums

from .. import layout as at
from ..simd.jit import called, jit
from .barrier import barrier
from .undo import flight_sums

merged = jit(sums.merged)


@called
def hand_over_sums(s):
    """Add the sums of all other threads to those of the first, and clear them."""
    length = at.FLIGHT_SUMS + flight_sums(s)
    thread = s.counter[at.THREAD]
    if thread > 0:
        for k in range(length):
            s.handed_sums[thread * length + k] = s.total[k]
            s.total[k] = 0.0
    barrier(s)
    if thread == 0:
        for other in range(1, s.counter[at.THREAD_COUNT]):
            add_sums(s, 0, other * length, at.SUMS)
            for species in range(s.counter[at.SPECIES_COUNT]):
                first = at.FLIGHT_SUMS + 2 * species * at.FLIGHT_SUM
                add_sums(s, first, other * length + first, at.FLIGHT_SUM)


@jit
def add_sums(s, first, handed, gap):
    """Add handed sums to those from `first` on; fractions are `gap` behind their whole numbers."""
    for k in range(gap):
        s.total[first + k], s.total[first + gap + k] = merged(
            s.total[first + k],
            s.total[first + gap + k],
            s.handed_sums[handed + k],
            s.handed_sums[handed + gap + k],
        )
