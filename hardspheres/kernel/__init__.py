"""The engine's kernels: how a gas of hard spheres is followed from collision to collision.

Between collisions a sphere moves in a straight line, so nothing has to be integrated: the engine finds the
earliest collision, executes it, and predicts again (Alder and Wainwright 1959, doi:10.1063/1.1730376). The
work is to find the earliest collision at a cost that does not grow with the number of particles. What follows
is the whole method, in reading order, room by room.

**The top.** `loop` is the algorithm: take the next event, execute it, predict the next events of its one or
two particles. `arrays` is the table of all arrays; `layout` names their slots, and is imported as `at`. What
a scene lacks is not compiled in: `specialise` loads the files of this package once for each kind of scene
(dimension, walls, many radii, many masses, search, growth, tallies of flights, gravity, threads), each with
its own constants in place of `flags`.

**`common`: what both searches use.** `particles`: a particle's row is its position, its velocity, and the
time when the two were written. Between events the row stays as it is: the position at a later time is x + v
(t - t_row). A row changes at its own collision and at the end of an epoch, when all rows fly to the same
time, return into the periodic box, and their clocks go back to zero; so times stay small and their rounding
too. An epoch's length is a power of two times the scene's time unit and follows from the scene alone. Where
masses differ and collisions have made the mean square speed so large at an epoch's end that this length is 16
times too long or longer, the following epochs are shorter by a power of two, and longer again once they can
be; that follows from the rows alone. The rows are the canonical state: everything else here can be thrown
away and found again from them, to the last bit.

`contact_times`: the time of contact of two particles is a pure function of their two rows and the periodic
image, with the formulas of `hardspheres.collision`. Many pairs are solved at once, without a branch, so that
the compiler uses vector instructions. `bucket_queue` and `event_heap`: coming events are in buckets by their
time. A bucket is a list of blocks, each a whole cache line, and the events of the current bucket are in a
small heap, so the next event is found in a time that does not depend on their number. Equal times are ordered
by the lower, then the higher id; a wall counts as the id n + 2 axis + side. `prefetch`: where a gas is larger
than the processor's caches, what the coming events need is prefetched; the method reads without it.
`tallies`, `flights`, `log`: what events add to the sums of the pressure; on request every free flight is
tallied when a collision of two particles ends it, and events are logged. That reads the rows and writes none
of them. All sums are exact sums of rounded terms (`hardspheres.sums`): the order of events decides no bit.

Two searches find which particles can collide. The density decides which one serves (`hardspheres.windows`),
and nothing that enters the trajectory does: both find the same events, to the last bit.

**`dense`: neighbour lists.** `neighbour_lists`: each particle has a list of those with which it can collide
while both stay within their displacement thresholds, as in Smallenburg's engine (2022,
doi:10.1140/epje/s10189-022-00180-8; before him Donev, Torquato and Stillinger 2005,
doi:10.1016/j.jcp.2004.08.014). The displacement is measured from a reference position, about a mean free time
ahead of the particle. Crossing the threshold is an event of the particle: its list is rebuilt from the 27
cells around it (`cell_grid`, `cutoff`), and no row changes. That costs seven times as much as a list costs
where all are rebuilt at once, cell by cell. So once a few in a hundred have been rebuilt, all are. Predicted
events stay as they are: a contact was predicted before the crossing of the old threshold, and that is all it
needs. A particle whose next event is its old threshold crossing is predicted again then; one that crosses its
new threshold before its next event has its list rebuilt then.

`prediction`: each particle has one next event, the earliest of its contacts with neighbours, its wall, and
its threshold crossing. A contact is stored with one of the two partners or with both. When a partner has
changed since, which its version tells, the event is stale, and its particle is predicted again at that
moment. This is safe: a pair's earliest contact was seen by whichever of the two was predicted last, and what
that particle has stored is never later. Both partners of a collision are predicted side by side, step by
step: each step waits for the one before, but not for those of the other. `calendar` (Brown 1988,
doi:10.1145/63039.63045) keeps the coming events in a ring of buckets. An event that no longer counts stays
where it is until its bucket is opened.

**`dilute`: windows of time.** `windows`: in a short window every flight is a known trajectory segment, and
few segments come near another. All `segments` are written, eight at a time, and sorted into columns of
`cells`, so that those near one stand in a few contiguous runs; `grid` has the geometry. Two segments are
compared by their quantised bounding boxes first: a box is six bytes, and sixteen are compared at once. Pairs
whose boxes overlap (`pair_table`) go through a vectorised `filter` in single precision, and what passes that
is computed exactly. `predicted_contacts` keeps the contacts of the window in buckets by their time. A
particle that has collided gets a new segment, which is compared again and takes the place of the old one, or
goes to an overflow list (`overflow`). Between collisions nothing happens at all, where lists would have to be
rebuilt many times for each collision of a dilute gas. A few large particles among small ones have a coarser
grid of their own (`large`).

**Gravity.** All particles may have the same acceleration (`hardspheres.gravity`). Then the separation of two
still changes in a straight line, and contacts are the same function of the two rows. Searches look at the gas
from a frame that falls with it, where every flight is straight: lists from one that is at rest when the epoch
begins, so that reference positions stay where they are until the lists of the next one; windows from one that
is at rest in their middle. Only walls see parabolas. A bounce takes its speed from what the particle had at
the floor after its last collision, which is kept beside its row.

**Obstacles.** A particle of infinite mass keeps its row, its version and its segment for ever (`obstacles`).
It has no events: those that move find it in their lists, or near their segments, and a collision with it
changes one row. Two of them are never compared, and may overlap.

**`threads`: one gas on several threads.** `loop` goes from window to window, in each of which some 1 % of the
particles collide, and all threads take the same decisions there. `tiles` are blocks of columns of cells, and
make the domains of a round; in `rounds` each domain executes its events in their order and puts off those
that are not well inside (`stopping` says when it may not go on). `tile_buckets`: events are in buckets by
tile. `undo` keeps the rows that a window replaces: they tell, exactly, whether a particle was predicted too
late to meet one of them; then the window is undone and gone through again in shorter ones, in the end by one
thread in the order of time. `barrier` and `handing_over` are where threads meet. With lists, `dense_round` is
a domain at work, `calendars` are those of the tiles, and `renewal` rebuilds lists, singly in rounds or all
together. With windows of time, `registration` finds the contacts of each, and `dilute_round` is a domain at
work; `contacts` of particles of two tiles are kept by both, `homes` tells where particles may collide, and a
search that would leave its domain is put off; `old_flights` has the rows that were replaced, by their cells.

**`simd`: how it is compiled.** `jit`, `parts`, `pointers`, `vectors`. Kernels find the arrays by a table of
their `addresses`. Arithmetic is strict wherever it enters the
trajectory: only + - x / sqrt and integers, no fused or reordered operations, so one scene gives the same bits
on every IEEE-754 machine. Only the filters of windows, whose margins cover their rounding, are coarser, and
may be fused.

**Growth.** To make dense random starts (`hardspheres.compression`) all radii may grow linearly in time: at
time t of an epoch they are the rows' radii times SCALE + GROWTH t. Contacts are then those of
`hardspheres.growth`, cutoffs allow for the largest size, and everything else is as before.
"""

from hardspheres.kernel.specialise import specialise

__all__ = ["specialise"]
