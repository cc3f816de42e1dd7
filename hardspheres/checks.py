"""What makes a scene: checks of its numbers, one by one; the first that fails raises SceneError."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hardspheres.cells import worst_overlap
from hardspheres.errors import SceneError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

BOUNDARIES = ("periodic", "wall")
AXES = "xyz"
# Of the largest diameter: above any overlap that the engine leaves, and too small to affect it.
LEFT_BY_ROUNDING = 1e-6


def boundary_words(boundary: str | Sequence[str], dim: int) -> tuple[str, ...]:
    """Return one word for each axis, or raise SceneError."""
    words = (boundary,) * dim if isinstance(boundary, str) else boundary
    if not isinstance(words, (tuple, list)) or not all(isinstance(w, str) and w in BOUNDARIES for w in words):
        raise SceneError(
            f'boundary is {boundary!r}; it must be "periodic" or "wall", or a sequence of one of them for '
            "each axis"
        )
    if len(words) != dim:
        raise SceneError(
            f"boundary has {len(words)} words for {dim} axes; give one word, or one for each axis"
        )
    return tuple(words)


def acceleration(gravity: ArrayLike | None, words: tuple[str, ...]) -> Floats:
    """Return the acceleration of all particles, (dim,), zero for None; or raise SceneError."""
    dim = len(words)
    if gravity is None:
        return np.zeros(dim)
    numbers = real_numbers(gravity, "gravity's components")
    if numbers.shape != (dim,):
        raise SceneError(
            f"gravity has shape {numbers.shape}, but the positions are {dim}-dimensional; give an "
            f"acceleration of {dim} components, such as {(*[0] * (dim - 1), -1)}"
        )
    for axis, pull in enumerate(numbers):
        if not math.isfinite(pull):
            raise SceneError(f"gravity along {AXES[axis]} is {pull}; it must be finite")
        if pull != 0.0 and words[axis] == "periodic":
            raise SceneError(
                f"gravity along {AXES[axis]} is {pull}, but that axis is periodic, and particles would fall "
                'round it for ever; give it walls (boundary="wall" on that axis), or no gravity'
            )
    return numbers + 0.0


def one_per_particle(values: ArrayLike, name: str, n: int, infinite: bool = False) -> Floats:
    """Radii or masses as (n,) positive numbers, from a number or n of them; else SceneError.

    Finite ones, or, where that is said, infinity too.
    """
    numbers = real_numbers(values, name)
    if numbers.ndim == 0:
        numbers = np.full(n, numbers[()])
    if numbers.shape != (n,):
        raise SceneError(
            f"{name} have shape {numbers.shape}; they must be one number or one for each of the {n} particles"
        )
    bad = np.flatnonzero(~((np.isfinite(numbers) | infinite) & (numbers > 0)))
    if len(bad):
        singular = {"radii": "radius", "masses": "mass"}.get(name, name)
        raise SceneError(
            f"the {singular} of particle {bad[0]} is {numbers[bad[0]]}; it must be positive"
            + (" (infinity makes an obstacle)" if infinite else " and finite")
        )
    return numbers


def obstacles_among(masses: Floats, velocities: Floats) -> Bools:
    """Which particles are obstacles, (n,); SceneError where one of them moves, or nothing else is there."""
    fixed: Bools = np.isinf(masses)
    moving = np.flatnonzero(fixed & np.any(velocities != 0.0, axis=1))
    if len(moving):
        velocity = " ".join(f"{v:.6g}" for v in velocities[moving[0]])
        raise SceneError(
            f"particle {moving[0]} has infinite mass and the velocity {velocity}; an obstacle never moves: "
            "give it the velocity 0, or a finite mass"
        )
    if fixed.all():
        raise SceneError("all particles have infinite mass; at least one must have a finite mass, to move")
    return fixed


def inertia(masses: Floats) -> Floats:
    """Masses with 0 for obstacles: what they stand still with counts in no sum."""
    fixed = np.isinf(masses)
    return np.where(fixed, 0.0, masses) if fixed.any() else masses


def integer_labels(values: ArrayLike | None, n: int) -> NDArray[np.int64] | None:
    """Labels as (n,) 64-bit integers, or None where there are none; SceneError for anything else."""
    if values is None:
        return None
    if isinstance(values, np.ma.MaskedArray):
        raise SceneError("labels are a masked array, whose masked values are not known; fill them in")
    raw = np.asarray(values) if hasattr(values, "__array__") else np.array(values, dtype=object)
    if raw.shape != (n,):
        raise SceneError(
            f"labels have shape {raw.shape}; they must be one integer for each of the {n} particles"
        )
    if raw.dtype.kind != "i":
        most = np.iinfo(np.int64)
        for particle, value in enumerate(raw.tolist()):
            if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
                raise SceneError(f"the label of particle {particle} is {value!r}; labels are integers")
            if not most.min <= value <= most.max:
                raise SceneError(f"the label of particle {particle} is {value}; labels have at most 64 bits")
    return np.array(raw, dtype=np.int64)


def real_numbers(values: ArrayLike, name: str) -> Floats:
    """Copy real numbers into a float64 array in C order, or raise SceneError."""
    parts = values if isinstance(values, (list, tuple)) else ()
    if any(isinstance(part, np.ma.MaskedArray) for part in (values, *parts)):
        raise SceneError(
            f"{name} are a masked array, whose masked values are not known; fill them in, or leave them out"
        )
    try:
        raw = np.asarray(values)
    except (TypeError, ValueError) as error:  # ragged rows, or an object that is no array
        raise SceneError(
            f"{name} cannot be made an array of numbers: rows differ in length or type"
        ) from error
    if raw.dtype.kind not in "iuf":
        kind = {"b": "truth values", "c": "complex numbers", "U": "text", "S": "text"}.get(
            raw.dtype.kind, str(raw.dtype)
        )
        raise SceneError(f"{name} hold {kind}; they must be real numbers")
    return np.array(raw, dtype=np.float64, order="C")


def box_edges(box: ArrayLike, dim: int) -> Floats:
    """Edge lengths of the box, (dim,), or SceneError."""
    edges = real_numbers(box, "box edges")
    if edges.shape != (dim,):
        raise SceneError(
            f"box has shape {edges.shape}, but the positions are {dim}-dimensional; give {dim} edge lengths"
        )
    for axis, edge in enumerate(edges):
        if not (math.isfinite(edge) and edge > 0):
            raise SceneError(f"the box edge along {AXES[axis]} is {edge}; it must be positive and finite")
    return edges


def require_finite(values: Floats, what: str) -> None:
    """Require finite positions or velocities."""
    if np.isfinite(values).all():
        return
    particle, axis = np.argwhere(~np.isfinite(values))[0]
    raise SceneError(
        f"the {what} of particle {particle} along {AXES[axis]} is {values[particle, axis]}; it must be finite"
    )


def wrapped(positions: Floats, box: Floats, periodic: Bools) -> Floats:
    """Positions with periodic coordinates in [0, L); those already there keep their bits."""
    for axis in np.flatnonzero(periodic):
        column = positions[:, axis]
        outside = (column < 0) | (column >= box[axis])
        folded = np.mod(column[outside], box[axis])
        folded[folded >= box[axis]] = 0.0  # -1e-20 folds to L - 1e-20, which rounds to L
        column[outside] = folded
    return positions


def require_long_axes(radii: Floats, box: Floats, periodic: Bools) -> None:
    """Require axes on which no pair meets through two images at once, nor one particle two walls."""
    largest = 2 * float(radii.max())
    for axis, edge in enumerate(box):
        needed = 2 * largest if periodic[axis] else largest
        if edge < needed:
            kind, times = ("periodic", "two") if periodic[axis] else ("wall", "one")
            plural = "s" if periodic[axis] else ""
            raise SceneError(
                f"the box edge along {AXES[axis]} is {edge}, but a {kind} axis must be at least {times} "
                f"largest diameter{plural} long, {needed}"
            )


def require_resolved(radii: Floats, box: Floats) -> None:
    """Refuse a box in which coordinates are too coarse for its particles."""
    smallest, rounding = 2.0 * float(radii.min()), contact_tolerance(box)
    if rounding > LEFT_BY_ROUNDING * smallest:
        axis = int(np.argmax(box))
        raise SceneError(
            f"the box edge along {AXES[axis]} is {box[axis]:.6g}, where rounding moves a coordinate by up to "
            f"{rounding:.2g}: more than a millionth of the smallest diameter, {smallest:.6g}; take a smaller "
            "box (a higher packing fraction)"
        )


def require_in_box(positions: Floats, box: Floats) -> None:
    """Require centres in [0, L] on each axis."""
    outside = np.argwhere((positions < 0.0) | (positions > box))
    if len(outside):
        particle, axis = outside[0]
        raise SceneError(
            f"the position of particle {particle} along {AXES[axis]} is {positions[particle, axis]}; in a "
            f"state of this scene it lies in the box, from 0 to {box[axis]}"
        )


def require_inside(
    positions: Floats, radii: Floats, box: Floats, periodic: Bools, tolerance: float, fixed: Bools
) -> None:
    """Require that no particle reaches beyond a wall by more than the tolerance; an obstacle's centre."""
    depth, particle, axis = worst_beyond_wall(positions, np.where(fixed, 0.0, radii), box, periodic)
    if depth > tolerance and fixed[particle]:
        raise SceneError(
            f"the centre of obstacle {particle} lies {depth:.6g} beyond a wall along {AXES[axis]}; an "
            f"obstacle may reach beyond a wall, but its centre lies in the box, from 0 to {box[axis]}"
        )
    if depth > tolerance:
        raise SceneError(
            f"particle {particle} reaches {depth:.6g} beyond a wall along {AXES[axis]}: its coordinate is "
            f"{positions[particle, axis]}, and a radius {radii[particle]:.6g} leaves room from "
            f"{radii[particle]} to {box[axis] - radii[particle]}"
        )


def worst_beyond_wall(
    positions: Floats, radii: Floats, box: Floats, periodic: Bools
) -> tuple[float, int, int]:
    """Largest reach of a particle beyond a wall, the particle, and the axis; (-inf, 0, 0) without walls."""
    worst = (-math.inf, 0, 0)
    for axis in np.flatnonzero(~periodic):
        beyond = np.maximum(radii - positions[:, axis], positions[:, axis] - (box[axis] - radii))
        particle = int(np.argmax(beyond))
        if beyond[particle] > worst[0]:
            worst = (float(beyond[particle]), particle, int(axis))
    return worst


def require_no_overlap(
    positions: Floats, radii: Floats, box: Floats, periodic: Bools, tolerance: float, fixed: Bools
) -> None:
    """Require that no two particles overlap by more than the tolerance, unless both are obstacles."""
    i, j, depth = worst_overlap(positions, radii, box, periodic, fixed)
    if depth > tolerance:
        contact = float(radii[i] + radii[j])
        if fixed[i] or fixed[j]:
            obstacle, particle = (i, j) if fixed[i] else (j, i)
            raise SceneError(
                f"obstacle {obstacle} overlaps particle {particle} by {depth / contact:.4g} of their contact "
                f"distance (the worst overlap): they are {contact - depth} apart and touch at {contact}; "
                "only obstacles may overlap each other"
            )
        raise SceneError(
            f"particles {i} and {j} overlap by {depth / contact:.4g} diameters (the worst overlap): they are "
            f"{contact - depth} apart and touch at {contact}; move them apart or reduce their radii"
        )


def contact_tolerance(box: Floats) -> float:
    """Depth of overlap that rounding alone explains: 4 eps times the longest edge.

    Two centres rounded to the spacing of doubles near L are off by up to eps L/2 on each axis, so their
    distance by up to sqrt(3) eps L; folding it to the nearest image and taking the root add less than eps L
    more.
    """
    return 4 * float(np.finfo(np.float64).eps) * float(box.max())
