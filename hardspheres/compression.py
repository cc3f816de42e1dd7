"""Dense random starts: spheres that move, collide and grow up to the packing fraction asked for.

The compression of Lubachevsky and Stillinger (J. Stat. Phys. 60, 561 (1990), doi:10.1007/BF01025983), in the
engine that runs everything else. Spheres are placed at random at a lower density and get thermal velocities;
then all radii grow by a common scale, linearly in time, in a box of fixed size. Growth proceeds in stages: at
the end of each the kinetic energy, which every collision of growing spheres raises, is rescaled to its
initial value, and the engine is built again with lists and cells for the next size.

**How fast.** The rate is gamma, the speed at which a mean diameter grows over the thermal speed. In a dilute
gas it has little effect. Near freezing the fluid needs time to equilibrate; at higher density, fast growth
gives a glass and very slow growth crystals. So gamma falls with the pressure from 0.1 to 0.004 and stays
there until the spheres jam; others take 0.001 and less to jam slowly (Donev, Torquato, Stillinger 2005,
doi:10.1016/j.jcp.2004.08.014; Skoge and others 2006, doi:10.1103/PhysRevE.74.041127). Spheres that jam at
0.647 with 0.004 do so at 0.649 with 0.001, after four times as many collisions.

All masses are equal during growth: equilibrium positions do not depend on masses, and heavy particles would
relax slowly.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres.cells import CellGrid
from hardspheres.checks import boundary_words
from hardspheres.clock import carried
from hardspheres.engine import Engine
from hardspheres.errors import SceneError, SimulationError
from hardspheres.initial import checked_arguments, cubic_box, with_velocities
from hardspheres.order import BondOrder, bond_order, bond_order_of_some
from hardspheres.placement import place_at_random
from hardspheres.scene import Scene, drift, kinetic_energy, returned_to_box
from hardspheres.slices import Slices
from hardspheres.tuning import collision_frequency
from hardspheres.velocities import POSITIONS, Seed, stream

Floats = NDArray[np.float64]

GROWTH = 0x67726F77  # name of the stream that the velocities of the growth are drawn from
EASY = {2: 0.40, 3: 0.30}  # packing fraction that random placement reaches at once
# relative excess of the radii during growth, so that the rounding of contacts leaves no overlap
MARGIN = 1e-10
FASTEST, SLOWEST = 0.1, 0.004  # gamma
THIN = 5.0  # compressibility factor up to which gamma is the fastest; from there it falls as its inverse cube
LARGEST_STEP = 0.05  # of the scale in one stage, relative
PART_OF_GAP = 0.25  # of the remaining gap, in one stage: the gap is 1/Z of a diameter
JAMMED = 1e5  # compressibility factor at which the growth gives up: 1e-5 of a diameter is left
RELAXATION = {2: 300, 3: 100}  # collisions per particle at the final size
ATTEMPTS, HASTE = 3, 3.0  # number of attempts if the result orders, and the factor on the rate for each
ORDERED = {2: 0.5, 3: 0.1}  # psi6, Q6 above which a scene of many particles is no fluid,
FLUCTUATION = {2: 20.0, 3: 4.0}  # or this over sqrt(N), if more: three times what dense fluids show, or more
ENOUGH = 20_000  # particles whose bonds say that there is no order: they give Q6 to 0.01, psi6 to 0.02
HEXATIC = 0.70  # packing fraction from which discs order by themselves


def compressed_gas(
    n: int = 4000,
    packing_fraction: float = 0.49,
    *,
    dim: int = 3,
    boundary: str | Sequence[str] = "periodic",
    velocities: str = "maxwell",
    temperature: float = 1.0,
    radii: ArrayLike = 0.5,
    masses: ArrayLike = 1.0,
    seed: Seed,
) -> Scene:
    """Make a dense gas without order: particles placed at random grow to their size while they collide.

    The growth is that of Lubachevsky and Stillinger (1990, doi:10.1007/BF01025983), see
    `hardspheres.compression`. At full size the gas relaxes for 100 collisions per particle (300 in 2D). After
    that the pressure of a fluid shows no drift (up to 0.49 in 3D and 0.68 in 2D); a denser system keeps
    traces of its preparation. Equal spheres jam near 0.645, discs (in grains of crystal) near 0.88, mixtures
    as the sizes allow. The box is a cube or square.

    Equal particles in 3D must have stayed fluid or glassy: the scene's bond-orientational order Q6
    (`bond_order`) is at most 0.1, or 4/sqrt(n) where that is more. Equal discs must have psi6 of at most 0.5,
    or 20/sqrt(n), up to a packing fraction of 0.70: from there to 0.72 they become hexatic and then solid
    spontaneously (Bernard, Krauth 2011, doi:10.1103/PhysRevLett.107.155704), so that order is expected, and
    psi6 is not tested. It relaxes slowly there, over far more than 300 collisions per particle: the order of
    a scene is not that of equilibrium. With few particles a fluid's order by chance is as large as a
    crystal's (n < 50 in 3D, n < 400 in 2D), and nothing is refused.

    Parameters
    ----------
    n : int
        Number of particles; any number >= 1.
    packing_fraction : float
        Volume of the particles over that of the box (areas in 2D).
    dim : int
        Dimension, 2 or 3.
    boundary : str or sequence of str
        ``"periodic"`` or ``"wall"``, for all axes or one word for each.
    velocities : str
        ``"maxwell"``, ``"equal-speeds"``, ``"two-temperatures"`` or ``"beams"``; see `draw_velocities`. They
        are drawn when the growth is over.
    temperature : float
        kT, in units of energy.
    radii, masses : float or (n,) array_like
        Radii and masses. The masses play no part in the growth.
    seed : int or numpy.random.SeedSequence
        Source of all random choices; the same seed gives the same scene. Another choice of velocities leaves
        the positions as they are.

    Returns
    -------
    Scene
        The gas.

    Raises
    ------
    SceneError
        When an argument is not as above; when the particles jam before (the message gives the packing
        fraction reached); when equal particles have ordered, also with faster growth.
    """
    n, dim, filled, sizes, weights = checked_arguments(n, packing_fraction, dim, radii, masses)
    words = boundary_words(boundary, dim)
    periodic = np.array([word == "periodic" for word in words])
    box = cubic_box(n, packing_fraction, filled, sizes, periodic)
    start = _start(sizes * (1.0 + MARGIN), packing_fraction, box, words, seed)
    worst = 0.0
    for attempt in range(ATTEMPTS):
        compression = Compression(start, sizes * (1.0 + MARGIN), HASTE**attempt)
        _complete(compression)
        positions = compression.scene.positions
        scene = Scene(positions, np.zeros_like(positions), sizes, weights, box, words)
        gas = with_velocities(scene, velocities, temperature, seed)
        order = order_of_crystal(gas)
        if order is None:
            return gas
        worst = max(worst, order.value)
    name = "Q6" if dim == 3 else "psi6"
    raise SceneError(
        f"the particles ordered in each of {ATTEMPTS} attempts, with {name} up to {worst:.3f} at packing "
        f"fraction {packing_fraction}; take another seed or packing fraction, or lattice_gas where a crystal "
        "is wanted"
    )


def order_of_crystal(scene: Scene) -> BondOrder | None:
    """Return the bond order of a scene that has ordered; None for one that has not or cannot be judged.

    Judged are equal particles, discs below a packing fraction of 0.70 only; see `compressed_gas` for the
    limits.
    """
    limit = crystal_threshold(scene)
    if math.isinf(limit):
        return None
    every = scene.n // ENOUGH
    if every > 1 and bond_order_of_some(scene, every).value < 0.5 * limit:
        return None
    order = bond_order(scene)
    return order if order.value > limit else None


def crystal_threshold(scene: Scene) -> float:
    """Return the bond order above which a scene has ordered; infinite where it cannot be judged."""
    if scene.n < 2 or scene.radii.min() < scene.radii.max():
        return math.inf
    if scene.dim == 2 and scene.packing_fraction >= HEXATIC:
        return math.inf
    return max(ORDERED[scene.dim], FLUCTUATION[scene.dim] / math.sqrt(scene.n))


def _start(
    radii: Floats, packing_fraction: float, box: Floats, boundary: tuple[str, ...], seed: Seed
) -> Scene:
    """Particles of at most half the volume at random positions; thermal velocities, a diameter per time."""
    dim = len(box)
    periodic = np.array([word == "periodic" for word in boundary])
    part = min(EASY[dim], 0.5 * packing_fraction) / packing_fraction
    while True:
        small = radii * part ** (1 / dim)
        try:
            positions = place_at_random(small, box, periodic, stream(seed, POSITIONS))
            break
        except SceneError:  # few particles between walls, say
            part *= 0.5
            if part < 1e-3:
                raise
    drawn = stream(seed, GROWTH).standard_normal(positions.shape) * (2.0 * float(np.mean(radii)))
    scene = Scene.as_placed(positions, small, np.ones(len(small)), box, boundary)
    return scene.with_state(scene.positions, drawn - drift(drawn, scene.masses, periodic))


def _complete(compression: "Compression") -> None:
    """Grow to full size and relax there, or raise SceneError."""
    try:
        while compression.scale < 1.0 and compression.pressure < JAMMED:
            compression.grow()
        if compression.scale == 1.0:
            compression.relax(RELAXATION[compression.scene.dim])
    except SimulationError:  # time stands still
        compression.pressure = math.inf
    if compression.scale < 1.0 or compression.pressure == math.inf:
        radii = compression.scene.radii
        advice = ", or start from lattice_gas if a crystal will do" if radii.min() == radii.max() else ""
        raise SceneError(
            f"the growth jammed at packing fraction {compression.packing_fraction:.4f} (compressibility "
            f"factor {compression.pressure:.2g}); ask for less than that{advice}"
        )


class Compression:
    """A compression in progress.

    Parameters
    ----------
    scene : Scene
        Initial state; radii smaller than the full ones, in the same proportions.
    radii : (N,) array
        Full radii.
    haste : float
        Factor on the rate of growth.

    Attributes
    ----------
    scene : Scene
        The spheres now, at their present size.
    scale : float
        Present size over full size.
    pressure : float
        Compressibility factor, from the virial of the latest stage.
    collisions : int
        Pair collisions so far.
    """

    def __init__(self, scene: Scene, radii: Floats, haste: float = 1.0) -> None:
        self.scene = scene
        self.scale = float(scene.radii[0] / radii[0])
        self.pressure = 1.0
        self.collisions = 0
        self._radii = radii
        self._haste = haste
        self._energy = scene.kinetic_energy
        self._diameter = 2.0 * float(np.mean(radii))
        self._slices = Slices(scene.n)
        # The engine has particles that are near one another near in memory. It is faster, with the same bits.
        cells = CellGrid(scene.positions, scene.box, scene.periodic, self._diameter)
        self._order = cells.order

    @property
    def packing_fraction(self) -> float:
        """Packing fraction now."""
        return self.scene.packing_fraction

    def grow(self) -> None:
        """Grow for one stage: by a fraction of the remaining gap, at most to full size."""
        gamma = FASTEST * min(1.0, (THIN / self.pressure) ** 3)
        speed = math.sqrt(2.0 * self._energy / (self.scene.dim * self.scene.n))
        rate = max(gamma, SLOWEST) * self._haste * speed / self._diameter
        step = min(LARGEST_STEP, PART_OF_GAP / self.pressure)
        until = min(1.0, self.scale * (1.0 + step))
        self._run(rate, until, (until - self.scale) / rate)

    def relax(self, collisions_per_particle: float) -> None:
        """Run at the present size, without growth."""
        pairs = math.ceil(0.5 * collisions_per_particle * self.scene.n)
        self._run(0.0, self.scale, pairs / self._collision_rate, pairs)

    @property
    def _collision_rate(self) -> float:
        """Expected pair collisions per unit time: by Z - 1 = (sigma/2d) sqrt(pi m/kT) nu, or by theory."""
        scene = self.scene
        speed = math.sqrt(2.0 * self._energy / (scene.dim * scene.n))
        by_pressure = (
            (self.pressure - 1.0)
            * 2.0
            * scene.dim
            * speed
            / (math.sqrt(math.pi) * 2.0 * float(np.mean(scene.radii)))
        )
        return 0.5 * scene.n * max(by_pressure, collision_frequency(scene))

    def _run(self, rate: float, until: float, duration: float, pairs: int | None = None) -> None:
        """One stage: the scale grows to `until`, or less if there are far more collisions than expected."""
        limit = pairs or math.ceil(3.0 * duration * self._collision_rate) + 10 * self.scene.n
        scene, order = self.scene, self._order
        last = scene.with_state(scene.positions[order], scene.velocities[order], self._radii[order] * until)
        engine = Engine(last, growth=(self.scale / until, rate / until))
        at, number = engine.layout, engine.arrays.number
        epoch, moment = carried(0, duration, engine.length)
        while not self._slices.run(engine, epoch, moment, limit):
            pass
        done = int(engine.arrays.counter[at.PAIRS])
        if done >= limit:
            epoch, moment = engine.last_event
            self.scale = until * min(float(number[at.SCALE] + number[at.GROWTH] * moment), 1.0)
        else:
            self.scale = until
        self.collisions += done
        self._read(engine, epoch * engine.length + moment, moment)

    def _read(self, engine: Engine, passed: float, moment: float) -> None:
        """Make the scene from the rows, moved to one time; measure the pressure and restore the energy."""
        at, scene, number = engine.layout, self.scene, engine.arrays.number
        rows = np.empty_like(engine.rows)
        rows[self._order] = engine.rows
        velocities = rows[:, at.V : at.V + scene.dim].copy()
        flown = rows[:, at.X : at.X + scene.dim] + velocities * (moment - rows[:, at.T])[:, None]
        positions = returned_to_box(flown, scene.box, scene.periodic)
        energy = kinetic_energy(velocities, scene.masses)
        if passed > 0.0 and energy > 0.0:
            virial = float(np.sum(number[at.GROWTH_VIRIAL : at.GROWTH_VIRIAL + scene.dim]))
            self.pressure = 1.0 + virial / (passed * (energy + self._energy))
            velocities *= math.sqrt(self._energy / energy)
        self.scene = scene.with_state(positions, velocities, self._radii * self.scale)
