"""Event-driven gases of hard spheres.

Importing this package is cheap: names are loaded when they are first used, so that neither Numba nor ASE nor
SciPy is loaded before it is needed.
"""

import importlib
from typing import TYPE_CHECKING, Any

from hardspheres.errors import (
    CheckpointError,
    HardSpheresError,
    InvariantError,
    SceneError,
    SimulationError,
    TrajectoryError,
)

if TYPE_CHECKING:
    from hardspheres import reference
    from hardspheres.collision import contact_time, elastic_collision
    from hardspheres.compression import compressed_gas
    from hardspheres.files import TrajectoryWriter, read_trajectory
    from hardspheres.frame import Frame
    from hardspheres.gases import real_gas
    from hardspheres.initial import lattice_gas, random_gas
    from hardspheres.order import BondOrder, bond_order
    from hardspheres.scene import Scene
    from hardspheres.simulation import Simulation
    from hardspheres.velocities import draw_velocities

__version__ = "0.1.0"

__all__ = [
    "BondOrder",
    "CheckpointError",
    "Frame",
    "HardSpheresError",
    "InvariantError",
    "Scene",
    "SceneError",
    "Simulation",
    "SimulationError",
    "TrajectoryError",
    "TrajectoryWriter",
    "bond_order",
    "compressed_gas",
    "contact_time",
    "draw_velocities",
    "elastic_collision",
    "lattice_gas",
    "random_gas",
    "read_trajectory",
    "real_gas",
    "reference",
]

_HOMES = {
    "BondOrder": "hardspheres.order",
    "Frame": "hardspheres.frame",
    "Scene": "hardspheres.scene",
    "Simulation": "hardspheres.simulation",
    "TrajectoryWriter": "hardspheres.files",
    "bond_order": "hardspheres.order",
    "compressed_gas": "hardspheres.compression",
    "contact_time": "hardspheres.collision",
    "draw_velocities": "hardspheres.velocities",
    "elastic_collision": "hardspheres.collision",
    "lattice_gas": "hardspheres.initial",
    "random_gas": "hardspheres.initial",
    "read_trajectory": "hardspheres.files",
    "real_gas": "hardspheres.gases",
}


def __getattr__(name: str) -> Any:
    if name == "reference":
        return importlib.import_module("hardspheres.reference")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return what a user needs, without the names that this file is made of."""
    return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
