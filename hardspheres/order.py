r"""Bond-orientational order of a whole scene, which distinguishes a fluid from a crystal.

A bond joins a particle to each of its nearest neighbours: 12 in 3D, 6 in 2D, by distance over contact
distance, so that particles of any sizes can be compared. All bonds together give, by their directions,

.. math:: Q_6 = \Big( \frac{4\pi}{13} \sum_{m=-6}^{6} |\langle Y_{6m} \rangle|^2 \Big)^{1/2} \quad (3D),
\qquad
          \psi_6 = |\langle e^{6 i \theta} \rangle| \quad (2D)

(Steinhardt, Nelson, Ronchetti 1983, doi:10.1103/PhysRevB.28.784; Halperin, Nelson 1978,
doi:10.1103/PhysRevLett.41.121). Both are invariant under rotations. Directions that are independent give
:math:`1/\sqrt{\text{bonds}}` as root mean square; in a dense fluid neighbours' bonds are correlated and it is
a few times that. One perfect crystal gives :math:`Q_6 = 0.5745` (fcc), 0.4848 (hcp), or :math:`\psi_6 = 1`
(triangular), whatever its density. Contributions of differently oriented grains add up at random, so that
many small ones give a small value.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hardspheres.cells import size_classes
from hardspheres.errors import SceneError
from hardspheres.scene import Scene

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

NEIGHBOURS = {2: 6, 3: 12}
# Of the largest crystal values: fcc and hcp, triangular.
PERFECT = {"fcc": 13 / math.sqrt(512), "hcp": 0.48476168522368, "triangular": 1.0}


@dataclass(frozen=True)
class BondOrder:
    """Bond-orientational order of a scene.

    Attributes
    ----------
    value : float
        Q6 in 3D, psi6 in 2D, between 0 and 1.
    bonds : int
        Number of bonds; two particles that are each other's neighbours share one.
    random : float
        1/sqrt(bonds), the root mean square of `value` for independent directions.
    """

    value: float
    bonds: int

    @property
    def random(self) -> float:
        """Root mean square of `value` for independent directions."""
        return 1.0 / math.sqrt(self.bonds)


def bond_order(scene: Scene) -> BondOrder:
    """Measure the global bond-orientational order, Q6 of spheres or psi6 of discs.

    Parameters
    ----------
    scene : Scene
        At least two particles. A neighbour counts once, by its nearest image.

    Returns
    -------
    BondOrder
        The value, and what to compare it with.

    Raises
    ------
    SceneError
        When there is only one particle.

    References
    ----------
    Steinhardt, Nelson, Ronchetti, Phys. Rev. B 28, 784 (1983), doi:10.1103/PhysRevB.28.784.
    """
    if scene.n < 2:
        raise SceneError("the scene has one particle only; bonds need at least two")
    return bond_order_of_some(scene, 1)


def bond_order_of_some(scene: Scene, every: int) -> BondOrder:
    """Estimate `bond_order` from the bonds of one particle in so many, evenly spread over the box."""
    i, j = _bonds(scene, every)
    r = scene.positions[i] - scene.positions[j]
    r -= np.where(scene.periodic, scene.box * np.rint(r / scene.box), 0.0)
    directions = r / np.sqrt(np.sum(r * r, axis=1, keepdims=True))
    return BondOrder(_q6(directions) if scene.dim == 3 else _psi6(directions), len(i))


def _bonds(scene: Scene, every: int = 1) -> tuple[Ints, Ints]:
    """Pairs i < j of which one, that counts, has the other among its nearest neighbours, each pair once."""
    from scipy.spatial import cKDTree

    wanted = min(NEIGHBOURS[scene.dim], scene.n - 1)
    box = np.where(scene.periodic, scene.box, 0.0)  # 0: an axis that does not wrap
    near, partners = [], []
    # Particles in an order in which those that are near follow each other: the trees are then in the cache.
    order = cKDTree(scene.positions, boxsize=box).indices[::every]
    positions, radii = scene.positions[order], scene.radii[order]
    for members in size_classes(
        scene.radii
    ):  # among particles of about one size the nearest centres are the nearest surfaces
        tree = cKDTree(scene.positions[members], boxsize=box)
        one_size = scene.radii[members].min() == scene.radii[members].max()
        count = min(wanted * (1 if one_size else 3) + 1, len(members))
        distance, index = tree.query(positions, k=np.arange(1, count + 1))
        partner = members[index]
        itself = partner == order[:, None]
        near.append(np.where(itself, np.inf, distance / (radii[:, None] + scene.radii[partner])))
        partners.append(partner)
    scaled, partner = np.concatenate(near, axis=1), np.concatenate(partners, axis=1)
    nearest = np.argsort(scaled, axis=1, kind="stable")[:, :wanted]
    j = np.take_along_axis(partner, nearest, axis=1).ravel()
    i = np.repeat(order, wanted)
    pairs = np.sort(np.minimum(i, j) * scene.n + np.maximum(i, j))  # four times as fast as np.unique
    pairs = pairs[np.diff(pairs, prepend=-1) > 0]
    return pairs // scene.n, pairs % scene.n


def _psi6(directions: Floats) -> float:
    turns = directions[:, 0] + 1j * directions[:, 1]
    return float(abs(np.mean(turns**6)))


def _q6(directions: Floats) -> float:
    """Q6 from the harmonics of degree 6 written out, Y_6m sqrt(4 pi/13) = c_m (x + iy)^m p_m(z)."""
    x, y, z = directions.T
    z2 = z * z
    polynomials = (
        (1 / 16, ((231 * z2 - 315) * z2 + 105) * z2 - 5),
        (math.sqrt(42) / 16, ((33 * z2 - 30) * z2 + 5) * z),
        (math.sqrt(105) / 32, (33 * z2 - 18) * z2 + 1),
        (math.sqrt(105) / 16, (11 * z2 - 3) * z),
        (math.sqrt(126) / 32, 11 * z2 - 1),
        (math.sqrt(693) / 16, z),
        (math.sqrt(231) / 32, np.ones_like(z)),
    )
    total = 0.0
    power = np.ones(len(z), dtype=np.complex128)
    for m, (coefficient, polynomial) in enumerate(polynomials):
        mean = coefficient * complex(np.mean(power * polynomial))
        total += (1 if m == 0 else 2) * abs(mean) ** 2  # m and -m have the same modulus
        power *= x + 1j * y
    return math.sqrt(total)
