"""In a round no domain reads or writes what another one writes: so threads need no lock.

Every access of the kernels, run as plain Python, to what all threads have is noted, with its domain. One
thread goes through the domains in turn; a race would be an access of two domains to one number in the same
round, and is found wherever it could happen, not only where it does.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

WATCHED = """
import json, sys
import numpy as np
import hardspheres as hs
from hardspheres import domains, engine, lists
from hardspheres.crew import OWN
from hardspheres.kernel.arrays import Arrays

np.seterr(all="ignore")
engine.idle_cores = lambda: 99
lists.divided = lambda cells, threads: domains.Domains(cells, 1, {across})
domains.COLLISIONS_IN_BUCKET = 0.2
rng = np.random.default_rng(1)
places = (np.stack(np.meshgrid(np.arange(26), np.arange(26), indexing="ij"), -1).reshape(-1, 2) + 0.5) * 1.3
scene = hs.Scene(positions=places, velocities=rng.normal(size=places.shape), radii=0.5, box=[26 * 1.3] * 2)
import warnings
warnings.simplefilter("ignore")
sim = hs.Simulation(scene, search="lists", threads=2)
kernels, at = sim._engine.kernels, sim._at
rounds = sys.modules[kernels.__name__.replace("threads.loop", "threads.rounds")]
private = {{array.name for array in OWN}} | {{array.view[0] for array in OWN if array.view}}
reads, writes, present, found, seen = {{}}, {{}}, [None], [], [0, 0]


class Watched:
    def __init__(self, name, array):
        self.name, self.array, self.shared = name, array, name not in private
        self.first, self.size = array.__array_interface__["data"][0], array.itemsize

    def note(self, notes, k):
        if not 0 <= k < len(self.array):
            raise IndexError(f"{{self.name}}[{{k}}]")
        if self.shared and present[0] is not None:
            notes.setdefault(present[0], {{}})[self.first + int(k) * self.size] = self.name

    def __getitem__(self, k):
        # In which tile a partner is may be asked while it is being frozen elsewhere: then it is not ours.
        if not (self.name == "event" and k % at.EVENT == at.TILE_WORD):
            self.note(reads, k)
        return self.array[k]

    def __setitem__(self, k, value):
        self.note(writes, k)
        self.array[k] = value


go_through_domain, agree = rounds.go_through_domain, rounds.agree


def watched_domain(s, domain, shift):
    present[0] = domain
    go_through_domain(s, domain, shift)
    present[0] = None


def watched_agree(s):
    for one in writes:
        for other in (reads.keys() | writes.keys()) - {{one}}:
            both = writes[one].keys() & (reads.get(other, {{}}).keys() | writes.get(other, {{}}).keys())
            found.extend(sorted({{writes[one][k] for k in both}}))
    seen[0] += 1
    seen[1] += len(writes)
    reads.clear(), writes.clear()
    agree(s)


kernels.handed_over = lambda arrays: Arrays(*map(Watched, Arrays._fields, arrays))
rounds.go_through_domain, rounds.agree = watched_domain, watched_agree
{change}
sim.run(collisions={collisions})
counter = sim._engine.arrays.counter
print(json.dumps([sorted(set(found)), seen, int(counter[at.REBUILDS]), int(counter[at.LEFT_OVER])]))
"""


def watched(across, collisions, change=""):
    """Names of arrays that two domains have used in one round; rounds, and domains in them that wrote."""
    script = WATCHED.format(across=across, collisions=collisions, change=change)
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "NUMBA_BOUNDSCHECK": "1"}
    run = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        env=environment,
        cwd=Path(__file__).parents[2],
        check=False,
    )
    assert run.returncode == 0, run.stderr[-2000:]
    return json.loads(run.stdout)


def test_no_domain_touches_what_another_one_writes():
    """With lists rebuilt one by one, and events put off."""
    found, (rounds, domains_that_wrote), rebuilt, put_off = watched((2, 2), 1500)
    assert found == []
    assert domains_that_wrote > rounds > 10
    assert rebuilt > 10
    assert put_off > 0


def test_domains_without_margins_would_touch_each_other():
    """If all particles of a domain counted as inside, those at its faces would collide across them."""
    everyone_inside = "sim._engine.arrays.inside_in[:] = 31"
    found, *_ = watched((2, 2), 300, everyone_inside)
    assert {"row", "event"} <= set(found)
