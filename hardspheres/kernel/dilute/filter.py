"""The filter: which pairs of trajectory segments come within contact, in single precision.

A segment is its midpoint (at the middle of the window), half of its displacement in the window, its padded
radius (radius and margin), in units of the longest cell edge, and its owner's id. Margins cover rounding, so
all pairs in contact pass, and a few more. The filter works through a table of pairs, eight at a time and
without a branch. What passes is computed exactly.
"""

import numpy as np

from .. import layout as at
from ..common.contact_times import pair_contact
from ..common.obstacles import is_obstacle
from ..common.prefetch import prefetch_partners
from ..flags import DIM, OBSTACLES, THREADS
from ..simd.jit import called, fast_arithmetic, jit
from ..simd.pointers import int64
from ..simd.vectors import gather_transposed, keep_marked
from .pair_table import image_in, slot_in
from .predicted_contacts import keep_contact

if THREADS:
    from ..threads.contacts import keep_contact_of
    from ..threads.homes import tile_of_segment

ONE = np.float32(1.0)
TWO = np.float32(2.0)
TINY = np.float32(1e-30)
SLACK = np.float32(
    1e-5
)  # for rounding: of squared distances, of b, of the moment from which a segment counts
EIGHT = 8  # segments that the filter compares at once


@jit
def new_segment(s):
    """Slot of the first of the latest two new segments, after the sorted ones and overflow lists."""
    first = s.counter[at.SEGMENT_ROOM] + s.counter[at.OVERFLOW_ROOM]
    return first + s.counter[at.THREAD] * at.LINE if THREADS else first


@fast_arithmetic
def compare(p, stride, k, q, own, code, ex, ey, ez):
    """B = r.v, v.v, and r.r less the squared contact distance of two segments, one in this image."""
    dx = (p[at.MIDPOINT * stride + k] - q[at.MIDPOINT * stride + own]) - np.float32((code & 3) - 1) * ex
    dy = (p[(at.MIDPOINT + 1) * stride + k] - q[(at.MIDPOINT + 1) * stride + own]) - np.float32(
        ((code >> 2) & 3) - 1
    ) * ey
    du = p[at.HALF_DISPLACEMENT * stride + k] - q[at.HALF_DISPLACEMENT * stride + own]
    dv = p[(at.HALF_DISPLACEMENT + 1) * stride + k] - q[(at.HALF_DISPLACEMENT + 1) * stride + own]
    rr = dx * dx + dy * dy
    b = dx * du + dy * dv
    vv = du * du + dv * dv
    if DIM == 3:
        dz = (p[(at.MIDPOINT + 2) * stride + k] - q[(at.MIDPOINT + 2) * stride + own]) - np.float32(
            (code >> 4) - 1
        ) * ez
        dw = p[(at.HALF_DISPLACEMENT + 2) * stride + k] - q[(at.HALF_DISPLACEMENT + 2) * stride + own]
        rr += dz * dz
        b += dz * dw
        vv += dw * dw
    limit = p[at.PADDED_RADIUS * stride + k] + q[at.PADDED_RADIUS * stride + own]
    return b, vv, rr - (limit * limit + SLACK)


@fast_arithmetic
def may_touch(b, vv, c, since):
    """Whether two segments may come within contact from `since` to 1, in half windows from the middle.

    They approach at first, b + since v.v < 0, and are in contact when nearest to each other or, if that is
    later, at the end. Two that touch and fly alike pass, too: b and v.v are 0 then, and may be different from
    0 in double precision.
    """
    return (b < SLACK - since * vv) & (c * vv <= b * b) & ((b + vv > 0.0) | (c + (TWO * b + vv) < 0.0))


@jit
def filter_pairs(s, m, since):
    """Compare the first m pairs of the table, and compute the contacts of those that may touch."""
    unit = s.number[at.SEGMENT_UNIT]
    ex, ey, ez = (
        np.float32(s.number[at.BOX] * unit),
        np.float32(s.number[at.BOX + 1] * unit),
        np.float32(s.number[at.BOX + 2] * unit),
    )
    passed = int64(0)
    for block in range(0, m, EIGHT):
        gather_transposed(s.pair_segments, 0, EIGHT, s.segments, s.pair_slot, block)
        for k in range(EIGHT):
            s.own_slots[k] = slot_in(s.pair_own[block + k])
        gather_transposed(s.pair_segments, at.SEGMENT * EIGHT, EIGHT, s.segments, s.own_slots, 0)
        marks = 0
        for k in range(EIGHT):
            code = image_in(s.pair_own[block + k])
            b, vv, c = compare(
                s.pair_segments, EIGHT, k, s.pair_segments, at.SEGMENT * EIGHT + k, code, ex, ey, ez
            )
            marks |= (1 << k) if may_touch(b, vv, c, since) else 0
        passed = keep_marked(s.passed, passed, block, m, marks)
    prefetch_partners(s, passed)
    for a in range(passed):
        pair = int(s.passed[a])
        slot, own, code = int(s.pair_slot[pair]), slot_in(s.pair_own[pair]), image_in(s.pair_own[pair])
        b, vv, c = compare(s.segments, 1, slot * at.SEGMENT, s.segments, own * at.SEGMENT, code, ex, ey, ez)
        when = min(max(-b / (vv + TINY), since), ONE)
        i = int64(s.segment_words[own * at.SEGMENT + at.OWNER])
        j = int64(s.segment_words[slot * at.SEGMENT + at.OWNER])
        if OBSTACLES and i > j and own < new_segment(s) and slot < new_segment(s) and not is_obstacle(s, j):
            twice = True  # who compares all sees this pair from both sides
            if THREADS:
                twice = tile_of_segment(s, own) == tile_of_segment(s, slot)
            if twice:
                continue
        predict_contact(s, i, j, when, own, slot)


@called
def filter_table(s, m, since):
    """Call `filter_pairs` where it is not worth an inlined copy."""
    filter_pairs(s, m, since)


@jit
def predict_contact(s, i, j, when, own, slot):
    """Compute the contact of two particles, in the image that is nearest when their segments are nearest."""
    if OBSTACLES and is_obstacle(s, i) and is_obstacle(s, j):
        return
    if i != j:
        about = s.number[at.MIDDLE] + s.number[at.HALF_WINDOW] * when
        time = pair_contact(s, i, j, about)
        if THREADS:
            keep_contact_of(s, min(i, j), max(i, j), time, own, slot)
        else:
            keep_contact(s, min(i, j), max(i, j), time)
