"""A gas that spreads from one end of a box into all of it: without collisions, and as a tracer with them.

In one dimension, between reflecting walls at 0 and L, particles start evenly in [0, W] and are displaced at
random, independently of where they start. Without collisions the displacement is v t, v from Maxwell's law:
normal with standard deviation s = sqrt(kT/m) t. A reflecting wall is undone by unfolding: a particle at y
beyond it stands for its mirror image, so that

    P(x in [a, b]) = sum over all images of [a, b] of 1/W int_0^W [Phi((b - x0)/s) - Phi((a - x0)/s)] dx0,

exact for an ideal gas, at all times. The same sum holds for diffusion, with s = sqrt(2 D t).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from analysis.theory.prediction import Prediction
from analysis.theory.transport import enskog_diffusion

__all__ = ["spread_entropy", "spread_shares", "tracer_displacement"]

FloatArray = NDArray[np.float64]

WIDE = 0.3  # s / L from which on the sum over cosines converges faster than that over images


def spread_shares(displacement: ArrayLike, edges: ArrayLike, length: float, filled: float) -> FloatArray:
    """Return the share of the particles in each cell after they were displaced at random between two walls.

    Narrow displacements by the sum over images above, its integral over x0 in closed form. Wide ones by
    cosines: the density is 1/L + 2/L sum over k >= 1 of c_k exp(-q_k^2 s^2 / 2) cos(q_k x), q_k = k pi / L,
    c_k = sin(q_k W)/(q_k W), because <cos(q x)> is that of the start times exp(-q^2 s^2 / 2), walls or not.

    Parameters
    ----------
    displacement : (...) array_like
        s, standard deviation of the displacement along the axis: sqrt(kT/m) t of an ideal gas, sqrt(2 D t) of
        diffusion, [length].
    edges : (b + 1,) array_like
        Edges of the cells between 0 and L, ascending, [length].
    length : float
        L, how far particles can go from wall to wall.
    filled : float
        W, 0 < W <= L: they start evenly spread over [0, W].

    Returns
    -------
    (..., b) array
        They add up to 1 where the edges go from 0 to L. Exact to 1e-14 of all.
    """
    s, x = np.asarray(displacement, dtype=np.float64)[..., None], np.asarray(edges, dtype=np.float64)
    if not (0.0 < filled <= length * (1.0 + 1e-12)):
        raise ValueError(f"filled = {filled}; expected more than 0 and at most the length, {length}")
    wide = s[..., 0] > WIDE * length
    below = np.where(wide[..., None], _by_cosines(s, x, length, filled), _by_images(s, x, length, filled))
    shares = np.diff(below, axis=-1)
    return np.where(shares > 4.0 * np.finfo(np.float64).eps, shares, 0.0)


def _by_images(s: FloatArray, x: FloatArray, length: float, filled: float) -> FloatArray:
    """Return P(x' < x), from the images of [0, x] at 2 m L for s << L."""
    found = np.zeros(np.broadcast_shapes(s.shape, x.shape))
    for m in range(-2, 3):
        high, low = 2 * m * length + x, 2 * m * length - x  # the image of [0, x] is [-x, x]
        for sign, end in ((1.0, high), (-1.0, low)):
            found += sign * (_ramp(end, s) - _ramp(end - filled, s))
    return found / filled


def _ramp(z: FloatArray, s: FloatArray) -> FloatArray:
    """Return the integral of Phi(z'/s) up to z: z Phi(z/s) + s phi(z/s); max(z, 0) for s = 0."""
    scale = np.where(s > 0.0, s, 1.0)
    u = z / scale
    smooth = z * special.ndtr(u) + scale * np.exp(-0.5 * u * u) / math.sqrt(2.0 * math.pi)
    return np.where(s > 0.0, smooth, np.maximum(z, 0.0))


def _by_cosines(s: FloatArray, x: FloatArray, length: float, filled: float) -> FloatArray:
    """Return P(x' < x), from as many cosines as matter for s > WIDE L."""
    last = math.ceil(math.sqrt(80.0) / (math.pi * WIDE))
    q = math.pi / length * np.arange(1, last + 1)
    weight = 2.0 / length * np.sin(q * filled) / (q * q * filled)
    damped = weight * np.exp(-0.5 * (q * s) ** 2)
    return np.asarray(x / length + damped @ np.sin(np.multiply.outer(q, x)))


def spread_entropy(shares: ArrayLike) -> FloatArray:
    """Return the coarse-grained entropy of positions per particle, from 0 in one half to ln 2 everywhere.

    ln 2 - sum over cells of p ln(b p) for b cells of equal size: the entropy of a gas that is spread evenly
    within each cell, over that of one spread evenly over half of the box. Exactly 0 where the particles fill
    b/2 cells evenly, and ln 2 where they fill all. It depends on the cells: finer ones see more order, and
    none are fine enough for Gibbs' entropy, which never changes.

    Parameters
    ----------
    shares : (..., b) array_like
        p, not negative; their sum is taken for 1.
    """
    p = np.asarray(shares, dtype=np.float64)
    p = np.maximum(p, 0.0) / p.sum(axis=-1, keepdims=True)
    return np.asarray(math.log(2.0) - math.log(p.shape[-1]) + special.entr(p).sum(axis=-1))


def tracer_displacement(
    time: ArrayLike,
    eta: float,
    dim: int,
    diameter: float = 1.0,
    mass: float = 1.0,
    temperature: float = 1.0,
) -> Prediction:
    """Return the standard deviation of the displacement of a particle along one axis, in equilibrium.

    s^2 = 2 D [t - (1 - exp(-g t))/g], g = kT/(m D), from a velocity autocorrelation exp(-g t) with Enskog's
    D: sqrt(kT/m) t without collisions, sqrt(2 D t) after many of them.

    Parameters
    ----------
    time : array_like
        t.
    eta, dim, diameter, mass, temperature
        As in `enskog_diffusion`.

    Returns
    -------
    Prediction
        u from that of D.
    """
    t = np.asarray(time, dtype=np.float64)
    with np.errstate(invalid="ignore"):  # D is infinite without collisions; so is its uncertainty, or not a number
        d = enskog_diffusion(eta, dim, diameter, mass, temperature)
    upper = d.value + np.nan_to_num(d.uncertainty)
    value, other = (_displacement(t, float(D), temperature / mass) for D in (d.value, upper))
    return Prediction(value, other - value)


def _displacement(t: FloatArray, diffusion: float, square: float) -> FloatArray:
    """Return s for a diffusion coefficient and the mean square of a component of the velocity."""
    x = square / diffusion * t
    far = np.maximum(x, 1e-4)
    share = np.where(x > 1e-4, 2.0 * (far + np.expm1(-far)) / far**2, 1.0 - x / 3.0)
    return np.asarray(math.sqrt(square) * t * np.sqrt(share))
