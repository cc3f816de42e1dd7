"""What an entry in the table of predicted contacts says: who meets, and whether that still holds."""

from .. import layout as at
from ..common.event_heap import push_event
from ..common.versions import version_of
from ..simd.jit import jit
from ..simd.pointers import from_bits


@jit
def versions_of(s, low, high):
    """Versions of both partners in one number; a wall has none."""
    versions = int(version_of(s, low)) << 32
    if high < s.counter[at.N]:
        versions |= int(version_of(s, high)) & at.STAMP_BITS
    return versions


@jit
def partners(s, c):
    """Lower and higher id of a predicted contact."""
    pair = s.contacts[c * at.CONTACT + at.CONTACT_PAIR]
    return pair >> 32, pair & at.STAMP_BITS


@jit
def contact_holds(s, c):
    """Whether neither partner of a contact has changed since it was predicted."""
    low, high = partners(s, c)
    return versions_of(s, low, high) == s.contacts[c * at.CONTACT + at.CONTACT_VERSIONS]


@jit
def push_contacts(s, block):
    """Push the contacts of a block of a bucket, as far as they still hold, to the event heap."""
    for k in range(1, (s.blocks[block * at.BLOCK] & 7) + 1):
        c = s.blocks[block * at.BLOCK + k]
        if contact_holds(s, c):
            entry = c * at.CONTACT
            push_event(
                s, from_bits(s.contacts[entry + at.CONTACT_TIME]), s.contacts[entry + at.CONTACT_PAIR], c
            )
