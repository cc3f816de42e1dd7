"""Files for other programs: reading and writing.

Files in reading order: `atoms` (scenes as ASE's Atoms and back), `columns` (names of quantities), `xyz`
(extended xyz, exact), `foreign` (formats with units of their own), `reader`, `writer`.
"""

from hardspheres.files.atoms import Reading, from_atoms, has_velocities, to_atoms
from hardspheres.files.reader import read_scene, read_structure, read_trajectory
from hardspheres.files.writer import TrajectoryWriter

__all__ = [
    "Reading",
    "TrajectoryWriter",
    "from_atoms",
    "has_velocities",
    "read_scene",
    "read_structure",
    "read_trajectory",
    "to_atoms",
]
