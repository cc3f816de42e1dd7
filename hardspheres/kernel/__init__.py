"""The engine's kernels: how a gas of hard spheres is followed from collision to collision.

Between collisions a sphere moves in a straight line, so nothing has to be integrated: the engine looks for the earliest
collision, lets it happen, and looks again (Alder and Wainwright 1959, doi:10.1063/1.1730376). The work is to know the earliest
collision at a cost that does not grow with the number of particles. What follows is the whole method, file by file.

**The rows** (`layout`, `events`). A particle's row is its position, velocity, and the time when the two were written. Between
events nobody touches it: the position at a later time is x + v (t - t_row). A row changes at its own collision and at the end
of an epoch, when all rows fly to the same time, return into the periodic box, and their clocks go back to zero; so times stay
small and their rounding too. An epoch's length is a power of two times the scene's time unit and follows from the scene alone;
where masses differ and collisions have made the mean square speed so large at an epoch's end that this length is 16 times too
long or longer, the following epochs are shorter by a power of two, and longer again once they can be. That, too, depends on the
rows and on nothing else.
The rows are the canonical state: everything else here can be thrown away and found again from them, to the last bit.

**The prediction** (`prediction`). The time of contact of two particles is a pure function of their two rows and the periodic
image, with the formulas of `hardspheres.collision`. All neighbours of a particle are predicted at once: one pass gathers
the separations, a second one solves all quadratics without a branch, so that the compiler uses vector instructions.

Two methods find out who can meet whom. Which one serves is decided by the density (`hardspheres.tuning`), and by nothing that
enters the trajectory: both find the same events, to the last bit.

*Dense: lists.* **The neighbours** (`neighbours`). Each particle has a list of those that it can meet while both stay in their
shells, as in Smallenburg's engine (2022, doi:10.1140/epje/s10189-022-00180-8; before him Donev, Torquato and Stillinger 2005,
doi:10.1016/j.jcp.2004.08.014). The shell's centre is about a mean free time ahead of the particle. Leaving the shell is an
event of the particle, which makes a new list from the 27 cells around it (`within`), and changes no row. That costs five times
as much as a list costs where all are made at once, cell by cell. So once a few in a hundred have been renewed all are. Events stay
as they are: a contact was to come before the end of the old shell, and that is all it needs. Who waits for the end of an old shell
is predicted again at that moment, and who comes out of the new one before its event renews its list then. **The events.** Each particle has one next event: the earliest of its contacts with neighbours,
its wall (`prediction`), and the end of its shell. A contact is written down with one of the two partners or with both. When a
partner has since changed, which its version tells, the event is stale: its particle is predicted again at that moment. This is
safe, because a pair's earliest contact was seen by whichever of the two was predicted last, and what that particle has written
down is never later. **The calendar** (`calendar`; Brown 1988, doi:10.1145/63039.63045) keeps the coming events in buckets by
their time. An event that no longer counts stays where it is until its bucket is opened.

*Dilute: windows* (`windows`). In a short window of time every flight is a known line and few lines come near another. All lines
are drafted, eight at a time (`unsorted`), and sorted into columns of cells (`line_cells`), so that those near one stand in a few
contiguous runs. Two lines are compared by the boxes that hold them, first: a box is six bytes, and sixteen are compared at once.
What overlaps goes through a vectorised filter in single precision (`segments`), and what passes that is computed exactly. Contacts
within the window are kept in buckets by their time (`contacts`); a particle that has collided gets a new line, which is compared
again and takes the place of the old one, or hangs in a chain (`chains`). Between collisions nothing happens at all, where lists
would have to be renewed many times for each collision of a dilute gas.
A few large particles among small ones have a coarser grid of their own (`large`).

Either way buckets are chains of whole cache lines (`blocks`), and the events of the current one lie in a small heap
(`agenda`), so that the next event is found in a time that does not depend on their number. Equal times are ordered by the
lower, then the higher id; a wall counts as the id n + 2 axis + side.

Where a gas is larger than the processor's caches, what the coming events need is fetched ahead (`fetch`); that too changes no bit.

**Flights** (`flights`, `log`). On request every free flight is tallied when a collision of two particles ends it, and events
are written down. That reads the rows and writes none of them; a full buffer makes the run return, and it goes on as if it had
not. Other kernels have nothing of it.

**Growth.** To make dense random starts (`hardspheres.compression`) all radii may grow linearly in time: at time t of an epoch they
are the rows' radii times SCALE + GROWTH t. Contacts are then those of `hardspheres.growth`, lists reach as far as the largest size
needs, and everything else is as before.

**The loop** (`loop`) takes the next event, executes it, and searches for what its one or two particles do next.

Arithmetic is strict wherever it enters the trajectory: only + - x / sqrt and integers, no fused or reordered operations, so one
scene gives the same bits on every IEEE-754 machine. Only the filters of `segments` and `line_cells`, whose margins cover
their rounding, are coarser, and may be fused.

**Specialisation.** What a scene lacks is not compiled in: `specialise` loads this package's files once for each kind of scene (its
dimension, whether it has walls, many radii, many masses, whether it is dilute, and whether its radii grow), each with its own constants in place of `flags`.
"""

from hardspheres.kernel.specialise import specialise

__all__ = ["specialise"]
