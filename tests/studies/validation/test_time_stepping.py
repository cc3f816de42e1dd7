"""Bouncing balls by time steps, and the oracle: exact small cases, their errors' order, and refusals."""

import mpmath
import numpy as np
import pytest
from scenes import gas

import hardspheres as hs
from hardspheres.reference import ReferenceSimulation
from studies.validation.accuracy_few import distance
from studies.validation.oracle import Oracle
from studies.validation.time_stepping import BACK_UP, BOUNCE, Stepper


def pair(offset, dim=3):
    """Two balls on a straight line towards each other, `offset` aside; in contact after 0.5 where that is 0."""
    x = np.full((2, dim), 5.0)
    x[:, 0], x[1, 1] = (3.0, 5.0), 5.0 + offset
    v = np.zeros((2, dim))
    v[:, 0] = 1.0, -1.0
    return hs.Scene(x, v, box=(10.0,) * dim)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_head_on_collision(dim):
    """With back-up exact to a rounding; without it off by the depth of the overlap, up to the flight of one step."""
    for dt in (0.3, 0.013):
        exact = Stepper(pair(0.0, dim), dt, BACK_UP)
        late = Stepper(pair(0.0, dim), dt, BOUNCE)
        for stepper in (exact, late):
            stepper.run(1.0)
            assert stepper.count.collisions == 1 and stepper.energy_drift == 0.0
            assert stepper.velocities[:, 0].tolist() == [-1.0, 1.0]
        assert np.allclose(exact.positions[:, 0], [3.0, 5.0], rtol=0, atol=1e-12)
        depth = late.positions[0, 0] - 3.0
        assert 0.0 <= depth <= 2.0 * dt and (depth > 1e-4 or dt > 0.1)


def test_a_graze_is_missed_unless_steps_are_short():
    """A chord of 0.2 diameters takes 0.1: steps of 0.3 jump over it, and the audit sees that; steps of 0.05 do not."""
    scene = pair(np.sqrt(1.0 - 0.1**2))
    missed = Stepper(scene, 0.3, audit=True)
    missed.run(3.0)
    assert (missed.count.collisions, missed.count.missed) == (0, 1)
    found = Stepper(scene, 0.05, audit=True)
    found.run(3.0)
    assert (found.count.collisions, found.count.missed) == (1, 0)


@pytest.mark.parametrize(("kind", "share"), [("3d", 8 / 3), ("2d", 1.0)])
def test_missed_collisions_of_a_dilute_gas(kind, share):
    """(8/3) dt^2 kT / m sigma^2 of all collisions are missed by spheres, dt^2 by discs, to five standard errors.

    A pair approaches within the diameter for h = sqrt(sigma^2 - p^2) / g, p the impact parameter and g the relative speed, and
    is missed with probability 1 - h/dt where h < dt. Over p that is a^2/3 for spheres and a^2/6 for discs, a = g dt / sigma;
    over collisions <g^2> is 8 and 6 kT/m.
    """
    stepper = Stepper(gas(kind, 2000, 0.01, seed=2), 0.1, BACK_UP, audit=True)
    stepper.run(150.0)
    count = stepper.count
    true = count.collisions + count.missed
    assert true > 5000
    assert abs(count.missed / true / 0.1**2 - share) < 5.0 * share / np.sqrt(count.missed) + 0.02 * share


@pytest.mark.parametrize(("kind", "eta"), [("3d", 0.3), ("3d", 0.01), ("2d", 0.3)])
def test_cells_find_every_pair(kind, eta):
    """A list from cells and one from all pairs give the same gas, and conserve what they should.

    Only who has two partners within one step can differ, by their order: a few particles of 300.
    """
    scene = gas(kind, 300, eta, seed=4)
    by_cells, by_pairs = Stepper(scene, 1e-3, BACK_UP), Stepper(scene, 1e-3, BACK_UP)
    by_pairs._margin = float(scene.box.min()) / 2.5
    assert max(by_cells._cells) >= 3 > max(by_pairs._cells)
    duration = 2.0 / (eta * 30.0)
    for stepper in (by_cells, by_pairs):
        stepper.run(duration)
        assert abs(stepper.energy_drift) < 1e-13
        assert np.abs(stepper.velocities.sum(axis=0) - scene.velocities.sum(axis=0)).max() < 1e-12
    assert by_cells.count.collisions == pytest.approx(by_pairs.count.collisions, rel=0.02)
    r = by_cells.positions - by_pairs.positions
    apart = np.linalg.norm(r - scene.box * np.rint(r / scene.box), axis=1)
    assert by_cells.count.collisions > 20 and np.mean(apart < 1e-9) > 0.9
    assert by_cells.count.tests < by_pairs.count.tests


def test_the_error_of_a_trajectory_falls_with_dt():
    """Bouncing balls to first order: a hundredth of the step, a hundredth of the error, within a factor of 3."""
    errors = []
    for seed in range(5):
        scene = gas("3d", 32, 0.3, seed=seed)
        oracle = Oracle(scene)
        oracle.advance(16)
        end = oracle.between()
        truth, _ = oracle.at(end)
        errors.append([])
        for method, dt in ((BOUNCE, 1e-3), (BOUNCE, 1e-5), (BACK_UP, 1e-5), (BACK_UP, 1e-6)):
            stepper = Stepper(scene, dt, method)
            stepper.run(end)
            errors[-1].append(distance(stepper.positions, truth, scene))
    long, short, backed, shorter = np.median(errors, axis=0)
    assert 30 < long / short < 300
    assert backed < 1e-10 < short  # the contact is exact, and what is left is the rounding of the steps,
    assert shorter > 3.0 * backed  # which grows with their number


@pytest.mark.parametrize(("dim", "eta"), [(3, 0.3), (3, 0.01), (2, 0.3)])
def test_the_oracle_is_the_plain_solver(dim, eta):
    scene = hs.random_gas(n=8, packing_fraction=min(eta, 0.2), dim=dim, seed=3)
    oracle = Oracle(scene)
    with mpmath.workdps(50):
        plain = ReferenceSimulation(scene, mpmath.mpf, mpmath.sqrt)
        for _ in range(5):
            expected, event = plain.step(), oracle.step()
            assert (event.first, event.second) == (expected.first, expected.second)
            assert abs(event.time - expected.time) < 1e-45
        moment = oracle.between()
        plain.fly(moment - plain.time)
        positions = np.array(plain.positions, dtype=float)
    assert distance(oracle.at(moment)[0], positions, scene) < 1e-15


def test_refusals():
    with pytest.raises(hs.SceneError, match="one kind of particle in a periodic box"):
        Stepper(gas("3d_walls", 10, 0.05), 0.01)
    with pytest.raises(hs.SceneError, match="one kind of particle in a periodic box"):
        Stepper(gas("3d_mixture", 10, 0.05), 0.01)
    with pytest.raises(hs.SceneError, match="a time step of 0"):
        Stepper(pair(0.0), 0.0)
    with pytest.raises(hs.SceneError, match="ask for more particles"):
        Oracle(hs.Scene([[0.5] * 3], [[1.0] * 3], box=(2.0, 2.0, 2.0)))
