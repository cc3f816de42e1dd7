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
from hardspheres import domains, engine, lists, windows
from hardspheres.crew import OWN
from hardspheres.kernel.arrays import Arrays

np.seterr(all="ignore")
engine.idle_cores = lambda: 99
lists.divided = windows.divided = lambda cells, threads: domains.Domains(cells, 1, {across})
domains.COLLISIONS_IN_BUCKET = 0.2
rng = np.random.default_rng(1)
counts, spacing = {gas}
places = (np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 2) + 0.5) * spacing
box = np.array(counts) * spacing
scene = hs.Scene(positions=places, velocities=rng.normal(size=places.shape), radii=0.5, box=box)
import warnings
warnings.simplefilter("ignore")
sim = hs.Simulation(scene, search="{search}", threads=2)
kernels, at = sim._engine.kernels, sim._at
rounds = sys.modules[kernels.__name__.replace("threads.loop", "threads.rounds")]
private = {{array.name for array in OWN}} | {{array.view[0] for array in OWN if array.view}}
reads, writes, present, found, seen = {{}}, {{}}, [None], [], [0, 0]


class Watched:
    def __init__(self, name, array):
        self.name, self.array, self.shared = name, array, name not in private
        self.first, self.size = array.__array_interface__["data"][0], array.itemsize

    def is_of_a_thread(self, k):
        # Whether it is a place that one thread alone uses: there is only one here.
        counter = sim._engine.arrays.counter
        new = int(counter[at.SEGMENT_ROOM] + counter[at.OVERFLOW_ROOM])
        width = {{"segments": at.SEGMENT, "segment_words": at.SEGMENT, "boxes": 1, "cell_of_segment": 1}}
        return self.name == "overflowed" or (self.name in width and k >= new * width[self.name])

    def note(self, notes, k):
        if not 0 <= k < len(self.array):
            raise IndexError(f"{{self.name}}[{{k}}]")
        if self.shared and present[0] is not None and not self.is_of_a_thread(k):
            notes.setdefault(present[0], {{}})[self.first + int(k) * self.size] = self.name

    def __getitem__(self, k):
        # In which tile a partner is may be asked while it is being frozen elsewhere: then it is not ours.
        # And whether it has changed: a contact that no longer holds will hold no more.
        tile_word = (self.name == "event" and k % at.EVENT == at.TILE_WORD) or (
            self.name == "home" and k % at.HOME == 0
        )
        version = at.SPARSE and self.name == "row_int" and k % at.ROW == at.VERSION
        if not (tile_word or version):
            self.note(reads, k)
        return self.array[k]

    def __setitem__(self, k, value):
        self.note(writes, k)
        self.array[k] = value


go_through_domain, agree = rounds.go_through_domain, rounds.agree


def watched_domain(s, domain, shift):
    if at.SPARSE:  # pairs are read eight at a time, and those beyond the last are dropped: let them be nobody's
        new = sim._engine.arrays.counter[at.SEGMENT_ROOM] + sim._engine.arrays.counter[at.OVERFLOW_ROOM]
        sim._engine.arrays.pair_slot[:] = sim._engine.arrays.pair_own[:] = new
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


LISTS = ("lists", ((26, 26), 1.3))
WINDOWS = ("windows", ((100, 6), 3.0))


def watched(of, across, collisions, change=""):
    """Names of arrays that two domains have used in one round; rounds, and domains in them that wrote."""
    script = WATCHED.format(search=of[0], gas=of[1], across=across, collisions=collisions, change=change)
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
    found, (rounds, domains_that_wrote), rebuilt, put_off = watched(LISTS, (2, 2), 1500)
    assert found == []
    assert domains_that_wrote > rounds > 10
    assert rebuilt > 10
    assert put_off > 0


def test_domains_without_margins_would_touch_each_other():
    """If all particles of a domain counted as inside, those at its faces would collide across them."""
    everyone_inside = "sim._engine.arrays.inside_in[:] = 31"
    found, *_ = watched(LISTS, (2, 2), 300, everyone_inside)
    assert {"row", "event"} <= set(found)


def test_no_domain_touches_what_another_one_writes_in_windows():
    """With searches put off, and flights of several segments; with a sibling."""
    found, (rounds, domains_that_wrote), _, put_off = watched(WINDOWS, (4, 1), 1500)
    assert found == []
    assert domains_that_wrote > rounds > 10
    assert put_off > 0
    found, *_ = watched(WINDOWS, (4, 1), 300, "sim._engine.arrays.inside_in[:] = 31")
    assert {"blocks", "segments"} <= set(found)
