"""A gas and all its events, as one page that needs nothing else.

The page gets positions and velocities at the start and, for every event, its time, the one or two particles
and the momentum transferred: 32 bytes in 2D and 40 in 3D, from which velocities after it follow to a
rounding. Between events particles fly straight, or in parabolas.
"""

from __future__ import annotations

import base64
import html
import json
import math
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hardspheres as hs
from hardspheres.event_log import event_dtype
from hardspheres.gravity import impact_square, impact_time
from hardspheres.temporary import replacing
from studies.fluid import collisions_at, kind_of

__all__ = ["Replay", "replay_by_steps", "view"]

MOST_PARTICLES = 20_000
MOST_EVENTS = 2_000_000
CLEARLY = 1e3  # by how much the change of a velocity in a collision exceeds the rounding of others
LONGEST = 1000.0  # collisions per particle: roundings of the page grow with their number


@dataclass(frozen=True, eq=False, repr=False)
class Replay:
    """A gas from a start on, event by event; `view` makes it. A notebook shows it.

    Attributes
    ----------
    scene : Scene
        The start.
    events : structured array
        As in `hardspheres.event_log.event_dtype`, times since the start.
    duration : float
        Time of the last event.
    """

    scene: hs.Scene
    events: NDArray[np.void]
    duration: float

    @property
    def collisions(self) -> int:
        """Pair collisions."""
        return int(np.sum(self.events["j"] < self.scene.n))

    def __repr__(self) -> str:
        return f"<Replay of {self.scene}: {len(self.events)} events, {self.collisions} of them collisions>"

    @property
    def _title(self) -> str:
        scene = self.scene
        still = scene.n - scene.n_moving
        who = f"{scene.n_moving} among {still} obstacles:" if still else f"{scene.n}"
        return f"{who} {kind_of(scene)}, packing fraction {scene.packing_fraction:.3g}"

    def _head(self) -> dict[str, Any]:
        scene = self.scene
        return {
            "n": scene.n,
            "dim": scene.dim,
            "events": len(self.events),
            "duration": self.duration,
            "box": scene.box.tolist(),
            "periodic": scene.periodic.tolist(),
            **({"gravity": scene.gravity.tolist()} if scene.falls else {}),
            "labels": None if self._labels is None else self._labels[0].tolist(),
        }

    @property
    def _labels(self) -> Any:
        """Labels that differ, and which of them each particle has; None where they tell nothing apart."""
        if self.scene.labels is None:
            return None
        names, which = np.unique(self.scene.labels, return_inverse=True)
        return (names, which) if len(names) > 1 else None

    def _data(self) -> bytes:
        scene, events = self.scene, self.events
        momenta = events["normal"] * events["impulse"][:, None]
        floats = (scene.positions, scene.velocities, scene.radii, scene.masses, events["time"], momenta)
        whole = [events["i"], events["j"], scene.species]
        whole += [] if self._labels is None else [self._labels[1]]
        parts = [part.astype("<f8") for part in floats] + [part.astype("<i4") for part in whole]
        return b"".join(part.tobytes() for part in parts)

    @cached_property
    def html(self) -> str:
        """The page."""
        here = Path(__file__).parent
        page = (here / "page.html").read_text(encoding="utf-8")
        fillings = {
            "@TITLE@": html.escape(self._title),
            "@HEAD@": json.dumps(self._head()),
            "@DATA@": base64.b64encode(self._data()).decode("ascii"),
            "@MODULE@": (here / "viewer.mjs").read_text(encoding="utf-8"),
        }
        for name, text in fillings.items():
            page = page.replace(name, text)
        return page

    def _repr_html_(self) -> str:
        style = "width:100%;height:900px;border:0"
        return f'<iframe srcdoc="{html.escape(self.html)}" style="{style}" title="{self._title}"></iframe>'

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the page: one file that any browser shows, without a network.

        Parameters
        ----------
        path : path
            Ends in ``.html``; replaced if it is there.

        Raises
        ------
        SimulationError
            If it does not, or cannot be written.
        """
        file = Path(path)
        if file.suffix.lower() not in (".html", ".htm"):
            raise hs.SimulationError(f"{file} must end in .html: it is a page for a browser")
        try:
            with replacing(file) as temporary:
                temporary.write_text(self.html, encoding="utf-8")
        except OSError as error:
            raise hs.SimulationError(f"{file} cannot be written: {error.strerror or error}") from error


def view(start: hs.Scene | hs.Simulation, collisions_per_particle: float = 10.0) -> Replay:
    """Run a gas and return all that happens, to be watched in a browser.

    Parameters
    ----------
    start : Scene or Simulation
        Where to begin. A simulation stays as it is; shown is what it will do next, to the last bit.
    collisions_per_particle : float, default 10
        How long, s = 2 collisions / N.

    Returns
    -------
    Replay
        `Replay.save` writes it as a page; a notebook shows it.

    Raises
    ------
    SimulationError
        If there are more than 20 000 particles or 2 000 000 events, if s is not between 0 and 1000, or if no
        collision is to come.

    Examples
    --------
    >>> import hardspheres as hs
    >>> from studies import view
    >>> view(hs.random_gas(n=200, packing_fraction=0.1, seed=1), collisions_per_particle=2).collisions
    200
    """
    if not isinstance(start, (hs.Scene, hs.Simulation)):
        raise hs.SimulationError(f"view takes a Scene or a Simulation, not {start!r:.60}")
    gas = start if isinstance(start, hs.Scene) else start.scene
    n = gas.n
    try:
        s = float(collisions_per_particle)
    except (TypeError, ValueError):
        s = math.nan
    if not 0.0 < s <= LONGEST:
        raise hs.SimulationError(
            f"collisions_per_particle is {collisions_per_particle!r}; it must be above 0 and at most "
            f"{LONGEST:g}"
        )
    if n > MOST_PARTICLES:
        raise hs.SimulationError(
            f"the viewer shows up to {MOST_PARTICLES} particles, and this gas has {n}; show a smaller one"
        )
    share = 1 if gas.n_moving == n else 2  # a collision with an obstacle has one partner that counts
    collisions = max(1, share * collisions_at(s, gas.n_moving))
    if collisions > MOST_EVENTS:
        raise _too_many(n)
    chunks: list[NDArray[np.void]] = []

    def keep(events: NDArray[np.void]) -> None:
        chunks.append(events)
        if sum(map(len, chunks)) > MOST_EVENTS:
            raise _too_many(n)

    simulation = hs.Simulation(start, log=keep) if isinstance(start, hs.Scene) else start.with_log(keep)
    scene, began = simulation.to_scene(), simulation.time
    try:
        if gas.n_moving == n:
            simulation.run(collisions=collisions)
        else:
            list(simulation.frames(collisions_per_particle=[simulation.collisions_per_particle + s]))
    except hs.SimulationError as error:  # none to come: what it says of `run` is of no use here
        told = re.sub(r"(; |, or |: )use run\(time=\.\.\.\)$", "", str(error))
        raise hs.SimulationError(told) from error
    events = np.concatenate(chunks)
    events["time"] -= began
    return Replay(scene, events, float(events["time"][-1]))


def replay_by_steps(scene: hs.Scene, collisions_per_particle: float = 10.0) -> Replay:
    """Return what `view` does of a small gas, without a log.

    A log needs kernels of its own, and compiling them takes longer than stopping at every collision of a few
    hundred particles to see whose velocities have changed. Wall collisions in between follow from
    the flights, straight ones or parabolas.

    Parameters
    ----------
    scene : Scene
        The start.
    collisions_per_particle : float, default 10
        How long, s = 2 collisions / N.
    """
    if scene.n_moving < scene.n:
        return view(scene, collisions_per_particle)
    simulation, n, walled = hs.Simulation(scene), scene.n, not scene.periodic.all()
    time, x, v = 0.0, simulation.positions, simulation.velocities
    found: list[tuple[float, int, int, NDArray[np.float64]]] = []  # time, i, j, momentum transferred
    for _ in range(collisions_at(collisions_per_particle, n)):
        simulation.run(collisions=1)
        now, after = simulation.time, simulation.velocities
        lasted = now - time
        before = v + scene.gravity * lasted
        if walled:
            for hit, i, axis, side, speed in sorted(_wall_hits(scene, x, v, lasted)):
                away = speed if side == 0 else -speed
                push = np.zeros(scene.dim)
                push[axis] = 2.0 * scene.masses[i] * away
                before[i, axis] = away + scene.gravity[axis] * (lasted - hit)
                found.append((time + hit, i, n + 2 * axis + side, push))
            x = simulation.positions
        change = np.abs(after - before).max(axis=1)
        changed = np.flatnonzero(change)
        if scene.falls and n > 2:  # velocities of all are rounded on the way
            changed = np.sort(np.argsort(change)[-2:])
            if not change[changed].min() > CLEARLY * np.sort(change)[-3]:
                changed = changed[:0]
        if len(changed) != 2:  # a velocity so little changed that it rounds to what it was: only a log tells
            return view(scene, collisions_per_particle)
        one, other = (int(i) for i in changed)
        found.append((now, one, other, scene.masses[one] * (after[one] - before[one])))
        time, v = now, after
    events = np.zeros(len(found), event_dtype(scene.dim))
    events["time"], events["i"], events["j"] = (np.array([row[k] for row in found]) for k in range(3))
    push = np.array([row[3] for row in found])
    events["impulse"] = np.linalg.norm(push, axis=1)
    events["normal"] = push / events["impulse"][:, None]
    events["free_path"] = np.nan
    return Replay(simulation.scene, events, time)


def _wall_hits(
    scene: hs.Scene, x: NDArray[np.float64], v: NDArray[np.float64], duration: float
) -> Iterator[tuple[float, int, int, int, float]]:
    """Yield time, particle, axis, side and speed of each wall collision of particles that fly for so long."""
    for axis in np.flatnonzero(~scene.periodic):
        room = scene.box[axis] - 2.0 * scene.radii  # of a centre; it bounces to and fro in it
        inside, speed = x[:, axis] - scene.radii, np.abs(v[:, axis])
        if scene.gravity[axis] != 0.0:
            for i in range(scene.n):
                start = float(inside[i]), float(v[i, axis])
                for hit, side, at in _bounces(*start, float(scene.gravity[axis]), float(room[i]), duration):
                    yield hit, i, int(axis), side, at
            continue
        ahead = np.where(v[:, axis] > 0.0, room - inside, inside)
        for i in np.flatnonzero(ahead < speed * duration).tolist():
            side = int(v[i, axis] > 0.0)
            for k in range(1 + int((speed[i] * duration - ahead[i]) / room[i])):
                hit = float((ahead[i] + k * room[i]) / speed[i])
                yield hit, i, int(axis), side ^ (k & 1), float(speed[i])


def _bounces(
    above: float, velocity: float, pull: float, room: float, duration: float
) -> Iterator[tuple[float, int, float]]:
    """Yield time, side and speed of each bounce of a ball that falls between two walls."""
    now = 0.0
    while True:
        sides = []
        for side, toward, gap, towards_it in (
            (0, -velocity, above, -pull), (1, velocity, room - above, pull)
        ):  # fmt: skip
            root = math.sqrt(max(impact_square(toward, max(gap, 0.0), towards_it), 0.0))
            sides.append((impact_time(toward, max(gap, 0.0), towards_it, root), side, root))
        wait, side, speed = min(sides)
        now += wait
        if not now < duration:
            return
        yield now, side, speed
        above, velocity = (0.0, speed) if side == 0 else (room, -speed)


def _too_many(n: int) -> hs.SimulationError:
    return hs.SimulationError(
        f"the viewer shows up to {MOST_EVENTS} events, and this would have more; ask for fewer collisions "
        f"per particle: below {2 * MOST_EVENTS // n}, and fewer where walls are hit often"
    )
