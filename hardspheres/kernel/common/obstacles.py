"""Obstacles: particles of infinite mass. Their rows never change, and no event is theirs.

Each particle that moves finds the obstacles that it meets by itself: a collision with one changes one row,
and what others know of the obstacle stays true.
"""

import math

from ..flags import OBSTACLES
from ..simd.jit import jit


@jit
def is_obstacle(s, i):
    """Whether nothing moves i."""
    return OBSTACLES and s.mass[i] == math.inf
