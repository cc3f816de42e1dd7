"""Checkpoints: a simulation as arrays, from which it goes on bit for bit, later and on any machine.

The rows are the canonical state (`hardspheres.kernel`), so pending events, neighbour lists and windows are
not stored: they are computed again from the rows. Stored are the scene that the simulation began with (from
which shells and windows follow), the present length of its epochs, the state that `kernel.layout` names, the
clock, where the tallies began, and what was counted before. Every number is checked before kernels use it.

A checkpoint of another version of the package is accepted if the version of the format is the same. That
version changes with the content of the file and with every change to the bits of a trajectory; labels, which
decide nothing, are stored where there are some.
"""

import json
import math
from typing import Any

import numpy as np

from hardspheres import __version__
from hardspheres.archive import Arrays
from hardspheres.checks import LEFT_BY_ROUNDING, contact_tolerance
from hardspheres.clock import FOREVER
from hardspheres.engine import Engine
from hardspheres.errors import CheckpointError, SceneError
from hardspheres.invariants import deepest_overlap
from hardspheres.scene import Scene, kinetic_energy, potential_energy, returned_to_box, squares_at_floor
from hardspheres.sums import are_sums
from hardspheres.tuning import epoch_length, pace

__all__ = ["from_arrays", "restored", "to_arrays"]

FORMAT = "hardspheres checkpoint"
VERSION = 4
SCENE = ("positions", "velocities", "radii", "masses", "box")


def to_arrays(engine: Engine) -> Arrays:
    """Return the arrays of a checkpoint (views) of an engine that is in pace and whose clock is kept."""
    about = {
        "format": FORMAT,
        "version": VERSION,
        "package": __version__,
        "boundary": list(engine.scene.boundary),
        "epoch_length": engine.length,
        "clock": list(engine.now),
        "tallied_since": list(engine.since),
    }
    if engine.heat:
        about["heat"] = True
    text = np.frombuffer(json.dumps(about).encode(), dtype=np.uint8)
    scene = {name: getattr(engine.scene, name) for name in SCENE}
    if engine.scene.labels is not None:
        scene["labels"] = engine.scene.labels
    if engine.scene.falls:
        scene["gravity"] = engine.scene.gravity
    arrays: Arrays = {"about": text} | scene | engine.state()
    return arrays


def restored(scene: Scene, arrays: Arrays, logs: bool, search: str) -> Engine:
    """Return an engine of this scene in the state that `to_arrays` gave, unchecked: for copies."""
    about = json.loads(arrays["about"].tobytes())
    engine = _fresh(scene, arrays, about, logs, search)
    if logs and "flight" not in arrays:
        arrays = _with_flights(engine, arrays)
    return _in_state(engine, arrays, about)


def from_arrays(arrays: Arrays, logs: bool = False, search: str = "auto") -> Engine:
    """Return the engine in the arrays of a file; CheckpointError where no simulation leaves such arrays."""
    about = _read_about(arrays)
    _require(
        "flight" in arrays or not logs,
        "log=... needs what only a simulation with free_paths=True or a log keeps, and this was none",
    )
    scene = _scene(arrays, about)
    heats = not (scene.falls or scene.n_moving < scene.n)
    _require(
        heats or not about.get("heat"), "it tallies heat under gravity or with obstacles, which no run does"
    )
    _require_epochs(scene, about["epoch_length"])
    engine = _fresh(scene, arrays, about, logs, search)
    _require_like(arrays, engine.state())
    _require_state(engine, arrays, about)
    return _in_state(engine, arrays, about)


def _with_flights(engine: Engine, arrays: Arrays) -> Arrays:
    """Return the arrays with tallies of flights that begin now: a log needs them."""
    complete = {name: array.copy() for name, array in engine.state().items()}
    for name, array in complete.items():
        if name in arrays:  # sums of flights come last
            array.reshape(-1)[: arrays[name].size] = arrays[name].reshape(-1)
    return arrays | complete


def _fresh(scene: Scene, arrays: Arrays, about: dict[str, Any], logs: bool, search: str) -> Engine:
    """Return an engine of this scene with the epochs of the checkpoint."""
    heat = about.get("heat", False)
    engine = Engine(scene, flights=logs or "flight" in arrays, logs=logs, search=search, heat=heat)
    length = about["epoch_length"]
    return engine if length == engine.length else engine.with_epochs(length)


def _in_state(engine: Engine, arrays: Arrays, about: dict[str, Any]) -> Engine:
    engine.restore(arrays)
    engine.now, engine.since = tuple(about["clock"]), tuple(about["tallied_since"])
    return engine


def _require(holds: Any, sentence: str) -> None:
    if not holds:
        raise CheckpointError(sentence)


def _read_about(arrays: Arrays) -> dict[str, Any]:
    """Return the header of the file, every value checked by type and range."""
    try:
        about: dict[str, Any] = json.loads(arrays["about"].tobytes())
        named = about["format"] == FORMAT
    except (KeyError, TypeError, ValueError, RecursionError):
        named = False
    _require(named, "it does not say that it is a checkpoint of hardspheres")
    names = ("version", "package", "boundary", "clock", "tallied_since", "epoch_length")
    version, package, boundary, clock, since, length = map(about.get, names)
    written = f"its format is version {version!r}, written by hardspheres {package!r}"
    _require(version == VERSION, f"{written}; this one reads version {VERSION}")
    words = _is_list(boundary, str, str) or _is_list(boundary, str, str, str)
    _require(words, "its boundary is not a list of words")
    times = _is_list(clock, int, float) and _is_list(since, int, float, int, int)
    _require(times, "its clock or the start of its tallies is invalid")
    _require(_is_list([length], float), "its epoch has no length")
    _require(isinstance(about.get("heat", False), bool), "whether it tallies heat is neither true nor false")
    return about


def _is_list(values: Any, *types: type) -> bool:
    """Whether this is a list of these types, with integers in range and floats finite and not negative."""
    if not isinstance(values, list) or [type(value) for value in values] != list(types):
        return False
    return all(isinstance(value, str) or (0 <= value < FOREVER and math.isfinite(value)) for value in values)


def _scene(arrays: Arrays, about: dict[str, Any]) -> Scene:
    for name in SCENE:
        _require(name in arrays, f"it has no {name}")
    try:
        positions, velocities, radii, masses, box = (arrays[name] for name in SCENE)
        words, labels, gravity = tuple(about["boundary"]), arrays.get("labels"), arrays.get("gravity")
        return Scene.as_left(positions, velocities, radii, masses, box, words, labels, gravity)
    except SceneError as error:
        raise CheckpointError(f"its scene is impossible: {error}") from None


def _require_epochs(scene: Scene, length: float) -> None:
    """Require a length of epochs that runs of this scene can reach."""
    usual = epoch_length(scene)
    shorter = math.frexp(length)[0] == 0.5 and 2.0**-60 * usual <= length < usual
    allowed = length == usual or (shorter and math.isfinite(pace(scene, usual)[1]))
    _require(allowed, f"its epochs are {length!r} long, but this scene's are {usual!r}")


def _require_like(arrays: Arrays, fresh: Arrays) -> None:
    """Require exactly the arrays of a fresh simulation of the scene, by name, type and shape."""
    names = {"about", *SCENE, *fresh} | ({"labels", "gravity"} & set(arrays))
    _require(set(arrays) == names, f"it holds {sorted(set(arrays) ^ names)} too much or too little")
    for name, array in fresh.items():
        given, right = (f"{a.dtype} of shape {a.shape}" for a in (arrays[name], array))
        _require(given == right, f"{name} is {given}; this scene has {right}")
        _require(np.isfinite(arrays[name]).all(), f"{name} holds a value that is not finite")


def _require_state(engine: Engine, arrays: Arrays, about: dict[str, Any]) -> None:
    """Require rows, clocks and counters that runs of this scene can reach, as far as the kernels need it."""
    at, length = engine.layout, engine.length
    counters = dict(zip(at.STATE_COUNTERS, arrays["counters"].tolist(), strict=True))
    numbers = dict(zip(at.STATE_NUMBERS, arrays["numbers"].tolist(), strict=True))
    counts = [arrays[name] for name in ("counters", "counts", "counts_then") if name in arrays]
    turns, (epoch, moment), since = arrays["turns"], about["clock"], about["tallied_since"]
    counted = all(np.all((part >= 0) & (part < FOREVER)) for part in counts)
    turned = np.all((turns > -FOREVER) & (turns < FOREVER))
    _require(counted and turned, "a counter is out of range")
    now = max(numbers[at.NOW], 0.0)
    agree = counters[at.EPOCH] == epoch and now <= moment <= length and numbers[at.LAST_ADVANCE] <= now
    _require(agree, "its clocks contradict each other")
    pairs, hits = counters[at.PAIRS], counters[at.WALL_HITS]
    begun = since[:2] <= [epoch, moment] and since[2] <= pairs and since[3] <= hits
    _require(begun, "its tallies begin after its time")
    for name in ("total", "total_then"):
        right = all(map(are_sums, engine.blocks(arrays[name])))
        _require(right, f"a sum in {name} is not a whole number and a fraction")
    _require_rows(engine, arrays["row"], arrays.get("fall"), now, moment)
    if engine.flights:
        _require_flights(arrays["flight"], engine.arrays.flight, at, epoch, length)


def _require_rows(engine: Engine, rows: Any, fall: Any, now: float, moment: float) -> None:
    """Require times within this epoch, the initial energy, and positions that particles can have reached."""
    at, scene = engine.layout, engine.scene
    x, v, t = rows[:, at.X : at.X + scene.dim], rows[:, at.V : at.V + scene.dim], rows[:, at.T]
    same = np.array_equal(rows[:, at.T + 1 :], engine.rows[:, at.T + 1 :])
    still = np.array_equal(rows[scene.obstacles], engine.rows[scene.obstacles])
    _require(still, "an obstacle is not where its scene has it")
    _require(same, "its rows have other radii than its scene")
    _require(np.all((t >= 0.0) & (t <= now)), "a row is of a time outside of the present epoch")
    with np.errstate(over="ignore"):
        energy = kinetic_energy(v, scene.masses) + potential_energy(x, scene)
    had = scene.kinetic_energy + scene.potential_energy
    _require(
        abs(energy - had) <= 1e-6 * had,
        f"its {'' if scene.falls else 'kinetic '}energy is {energy:.6g}, that of its scene {had:.6g}",
    )
    if scene.falls:
        least, squares = 1e-6 * had / scene.masses[:, None], squares_at_floor(scene, x, v).reshape(v.shape)
        fits = np.abs(fall.reshape(v.shape) - squares) * (scene.gravity != 0.0) <= least
        _require(fits.all(), "the speed of a particle at the floor does not fit its row")
    fastest = np.sqrt(2.0 * energy / scene.masses)
    rounding = max(4.0 * contact_tolerance(scene.box), LEFT_BY_ROUNDING * 2.0 * float(scene.radii.max()))
    flown = np.where(scene.periodic, (1.0 + 1e-6) * (fastest * t)[:, None], 0.0) + rounding
    margin = np.where(scene.periodic | scene.obstacles[:, None], 0.0, scene.radii[:, None])
    near = np.all((x >= margin - flown) & (x <= scene.box - margin + flown))
    _require(near, "a particle is further from the box than it can have flown")
    dt = (moment - t)[:, None]
    flown = x + (v + 0.5 * scene.accelerations * dt) * dt if scene.falls else x + v * dt
    positions = returned_to_box(flown, scene.box, scene.periodic)
    overlap, allowed = deepest_overlap(positions, scene), rounding / (2.0 * float(scene.radii.min()))
    _require(overlap <= max(LEFT_BY_ROUNDING, allowed), f"its particles overlap by {overlap:.3g} diameters")


def _require_flights(given: Any, fresh: Any, at: Any, epoch: int, length: float) -> None:
    """Require flights that fit the species of the scene and began before now, or are marked as unknown."""
    flight, known = given.reshape(-1, at.FLIGHT), fresh.reshape(-1, at.FLIGHT)
    began, began_epoch = flight[:, at.BEGAN], flight[:, at.BEGAN_EPOCH]
    possible = (began >= 0.0) & (began <= length) & (began_epoch >= -1.0) & (began_epoch <= epoch)
    possible &= (began_epoch == np.floor(began_epoch)) & (flight[:, at.SPECIES] == known[:, at.SPECIES])
    _require(np.all(possible), "its free flights are not of this scene")
