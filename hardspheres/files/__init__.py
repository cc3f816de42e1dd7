"""Files for other programs: reading and writing.

Files in reading order: `xyz` (extended xyz, exact), `hoomd` (GSD, exact), `foreign` (formats with units of
their own), `reader`, `writer`. Scenes as ASE's Atoms, and back, are in `hardspheres.atoms`.
"""

from hardspheres.atoms import Reading, has_velocities, to_atoms
from hardspheres.files.reader import read_scene, read_structure, read_trajectory, structures
from hardspheres.files.writer import TrajectoryWriter

__all__ = [
    "Reading",
    "TrajectoryWriter",
    "has_velocities",
    "read_scene",
    "read_structure",
    "read_trajectory",
    "structures",
    "to_atoms",
]
