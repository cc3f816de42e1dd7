"""The slots of the engine's flat arrays, by name: kernels import this module as `at` and read `at.PAIRS`.

The arrays themselves are listed in `arrays`.
"""

from .flags import (  # noqa: F401  `arrays` reads MASSES
    DIM,
    FLIGHTS,
    GRAVITY,
    GROWS,
    HEAT,
    MASSES,
    OBSTACLES,
    SIZES,
    SPARSE,
    THREADS,
)


class Slots:
    """The slots of an array, handed out one after the other."""

    def __init__(self, first=0):
        self.end = first

    def __call__(self, slots=1):
        """Return the first of so many slots."""
        first, self.end = self.end, self.end + slots
        return first


# A particle's row, 8 float64 (one cache line): the canonical state. One more row, of NaN, is the null
# particle, which collides with nothing.
ROW = 8
X = 0  # position when the row was last written, DIM numbers
V = DIM  # velocity, DIM numbers
T = 2 * DIM  # when that was, relative to the epoch
RADIUS = 7
# Threads: the row's version, int64, where there is room for it. Elsewhere versions of many particles share a
# line of the cache, and threads that write to it wait for each other.
VERSION_IN_ROW = THREADS and (DIM == 2 or not SIZES)
VERSION = 2 * DIM + 1

# A particle's next event, 8 int64 (one cache line); TIME and REFERENCE hold float64 bits. Windows need none.
EVENT = 0 if SPARSE else 8
TIME = 0
PARTNER = 1  # a particle, n + 2 axis + side for a wall, or one of the codes below
PARTNER_VERSION = 2  # the partner's version when the event was predicted
STAMP = 3  # of the one queue entry that counts
REFERENCE = 4  # reference position of the particle's list (unwrapped as the row), DIM numbers
TILE_WORD = 7  # threads: where it is, and whether it is frozen (`threads.tiles`)
TILE_SHIFT, TILE_BITS = 8, 0xFFFF  # where in that word the tile stands

OLD_ROW_OF = 8  # threads, int64: each has a line of the cache of its own

# Squared speed, along each axis, that a particle has whenever it is at the wall that gravity pulls it to: as
# long as it meets nobody, this stays as it is.
FALL = DIM if GRAVITY else 0

REBUILD = -1  # the particle is at its displacement threshold: a new neighbour list is due
NOTHING = -2  # no event before the epoch ends
STALE_EVENT = -3  # none any more: the partner has changed since it was predicted

# Numbers, float64.
slot = Slots()
BOX = slot(3)  # edge lengths
INVERSE = slot(3)  # 1/edge on periodic axes, 0 on wall axes
EPOCH_LENGTH = slot()  # length of an epoch in time
PER_EPOCH = slot()  # 1 / it, a power of two as it is
SIGMA2 = slot()  # squared contact distance, where all radii are equal
COMMON_RADIUS = slot()  # radius, where all radii are equal
REDUCED = slot()  # reduced mass of a pair, where all masses are equal
MASS = slot()  # mass, where all are equal
SCALE = slot()  # growth: at the epoch's start all radii are this many times those given
GROWTH = slot()  # how much that grows in a unit of time
# Diagonal of the virial, a sum in the order of events: growth goes by it, so it decides what starts are made.
GROWTH_VIRIAL = slot(3 if GROWS else 0)
NOW = slot()  # time of the last event, relative to the epoch
LAST_ADVANCE = slot()  # NOW when time last advanced
ORDER_TOLERANCE = slot()  # an event is out of order if predicted more than this before NOW
MEAN_SQUARE = slot()  # mean square speed when this epoch began, where masses differ
UPPER_MEAN_SQUARE = slot()  # from this mean square speed on epochs are too long
LOWER_MEAN_SQUARE = slot()  # below this one they are too short
INVERSE_WIDTH = slot()  # 1/width of a bucket in time
CELL_DENSITY = slot(3)  # cells per length
CELL_EDGE = slot(3)  # edges of a cell
DISPLACEMENT_THRESHOLD = slot()  # lists: how far a particle may go from REFERENCE before its list is rebuilt
CUTOFF = slot()  # neighbours' reference positions are closer (plus both radii, where radii differ)
LEAD = slot()  # how far in time a reference position is ahead of its particle
HALF_WINDOW = slot()  # windows: half their length in time
MIDDLE = slot()  # time at the middle of the window
HALF_LENGTH = slot()  # how far a segment reaches from its middle, at most
SEGMENT_UNIT = slot()  # 1 / the unit of length of segments
SEGMENT_MARGIN = slot()  # added to the radius, for rounding
UNIT_DENSITY = slot(3)  # units of bounding boxes per length
SEGMENT_OVERHANG = slot(3)  # how far a segment may reach beyond its cell
SMALL_RADIUS = slot()  # particles with a larger radius are in the coarse grid
LARGEST = slot()  # largest radius
LARGE_DENSITY = slot(3)  # coarse cells per length
PULL = slot(3 if GRAVITY else 0)  # acceleration of all particles
WEIGHT = slot(3 if GRAVITY else 0)  # that times the mass of all
TICKS = slot(1 if THREADS else 0)  # threads: ticks per time; a bucket has BUCKET_TICKS of them
LATEST = slot(1 if THREADS else 0)  # time of the last event in windows that stand
LATEST_IN_WINDOW = slot(1 if THREADS else 0)
WINDOW_BEGIN = slot(1 if THREADS else 0)  # no event to come is earlier
STOP_TIME = slot(1 if THREADS else 0)  # later events wait for another run
# 1 / the unit of a kind of sum, powers of two (`hardspheres.tally_units`); momentum is m v, and so on.
PER_IMPULSE = slot()  # m v
PER_VIRIAL = slot()  # m v x
PER_STRESS = slot()  # m v v
PER_STRESS_MOMENT = slot()  # m v v t
PER_HEAT_TRANSFER = slot()  # m v v x
PER_HEAT_FLUX = slot()  # m v v v
PER_HEAT_MOMENT = slot()  # m v v v t
NUMBERS = slot.end
# Where FLIGHTS, of each species: 1 / the units of the bins of paths, times and speeds, and 1 / powers of two,
# for the sums of paths and times.
FLIGHT_UNITS = NUMBERS
PER_PATH, PER_TIME = 3, 4
FLIGHT_UNIT = 5

# Sums since the start (`hardspheres.sums`), float64: all whole numbers, then as many fractions. Symmetric
# tensors as xx, yy, zz, xy, xz, yz; in 2D as xx, yy, xy.
TENSOR = 6 if DIM == 3 else 3
SHEAR = DIM - 1  # component ab is that of a + b + SHEAR, where a and b differ
slot = Slots()
VIRIAL = slot(TENSOR)  # sum of r_a dp_b over pair collisions
STRESS = slot(TENSOR)  # sum of d(m v_a v_b) over events
STRESS_MOMENT = slot(TENSOR)  # sum of (time within the epoch) d(m v_a v_b) over events of this epoch
PADDING = slot(2 if DIM == 3 else 3)  # always 0: these three are added to in vectors of four
WALL_IMPULSE = slot(6)  # momentum given to the wall, per axis: lower, upper
WALL_RADIUS_IMPULSE = slot(6)  # the same times the particle's radius
HEAT_TRANSFER = slot(3 if HEAT else 0)  # sum of r_a dE over pair collisions
HEAT_FLUX = slot(3 if HEAT else 0)  # sum of d(v_a E) over events, E the energy of a particle
HEAT_MOMENT = slot(3 if HEAT else 0)  # as of the stress
LEDGER = slot(3)  # net momentum given to walls and obstacles, less that of gravity
SUMS = slot.end
FLIGHT_SUMS = 2 * SUMS

# Integrals over time, up to the present epoch, of STRESS and HEAT_FLUX: float64, then what these lack.
slot = Slots()
STRESS_INTEGRAL = slot(TENSOR)
HEAT_INTEGRAL = slot(3 if HEAT else 0)
INTEGRALS = slot.end

# Counters, int64.
slot = Slots()
N = slot()
EPOCH = slot()
PAIRS = slot()  # pair collisions
WALL_HITS = slot()
OUT_OF_ORDER = slot()
STALE = slot()
INSTANT_EVENTS = slot()  # events at one instant: since time last advanced
LAST_PAIR_EPOCH = slot()  # epoch of the last pair collision
LOGGED = slot()  # events in the log's buffer
LOG_ROOM = slot()  # how many it can hold; 0: there is no log
SPECIES_COUNT = slot()  # species that flights are told apart by
BEYOND_CACHE = slot()  # 1: the gas is larger than a core's caches, so what is needed soon is prefetched
BEYOND_ALL = slot()  # 1: it is larger than those that cores share, too
SHORT_LISTS = slot()  # set where room ran out: the run stops, makes room, and searches again from the rows
SHORT_CELLS = slot()
SHORT_QUEUE = slot()
BUCKETS = slot()  # buckets in a cycle of the calendar, or in a window: a power of two
EPOCH_BUCKETS = slot()  # buckets in an epoch
BUCKET = slot()  # the current bucket, counted from the epoch's start
BLOCKS = slot()  # blocks of buckets
FREE_BLOCK = slot()  # head of the list of free blocks
HEAP_LENGTH = slot()
HEAP_ROOM = slot()
CELLS = slot(3)  # cells per axis
CELL_ROOM = slot()  # lists: particles that a cell can hold
LIST_ROOM = slot()  # slots in a neighbour list, a multiple of LANES
IMAGES = slot()  # 1: lists store the image index, as the nearest image may not be the one meant
REBUILDS = slot()
REBUILD_THRESHOLD = slot()  # single rebuilds after which all are rebuilt at once
REBUILD_ALL_DUE = slot()  # how many single rebuilds there have been then
REBUILDS_OF_ALL = slot()  # how often all lists were rebuilt at once
WAITS = slot()  # which of those that wait for their bucket is the next
WINDOW_BUCKETS = slot()  # buckets in a window; 0 for lists
SEGMENT_ROOM = slot()  # windows: segments that the cells can hold
REGISTERED = slot()  # segments at the beginning of this window
OVERFLOW_ROOM = slot()
OVERFLOWED = slot()  # new segments of this window in overflow lists
CONTACT_ROOM = slot()
CONTACTS = slot()  # contacts predicted in this window
NEAR_ROOM = slot()  # pairs with overlapping bounding boxes that the table can hold
WIDTH = slot(3)  # of a cell in the units of bounding boxes
OVERHANG = slot(3)  # how far a segment may reach beyond its cell in these units
LARGE = slot()  # how many particles are in the coarse grid
LARGE_CELLS = slot(3)  # coarse cells per axis
RESTING = slot(1 if GRAVITY else 0)  # 1 + a particle that has come to rest on a wall
OBSTACLE_HITS = slot(1 if OBSTACLES else 0)  # those of the pair collisions with an obstacle
THREAD = slot(1 if THREADS else 0)  # threads: which one this is
THREAD_COUNT = slot(1 if THREADS else 0)
TILES = slot(1 if THREADS else 0)
DOMAINS = slot(1 if THREADS else 0)
SHIFTS = slot(1 if THREADS else 0)  # in how many ways tiles make domains: 1, 2 or 4
SHIFT = slot(1 if THREADS else 0)  # the present one
DOMAIN = slot(1 if THREADS else 0)  # the domain at work
ROUND = slot(1 if THREADS else 0)
WINDOW = slot(1 if THREADS else 0)  # number of this window, or of this attempt at it
TICK = slot(1 if THREADS else 0)  # the first of this window
LIMIT = slot(1 if THREADS else 0)  # the first after it
PRESENT_TICK = slot(1 if THREADS else 0)  # whose events are in the heap
QUEUED = slot(1 if THREADS else 0)  # events that were queued for later ticks of this window
BUCKET_TICKS = slot(1 if THREADS else 0)  # ticks in a bucket, a power of two
WINDOW_TICKS = slot(1 if THREADS else 0)  # how long windows are, a power of two
UNDISTURBED = slot(1 if THREADS else 0)  # windows since that was changed
IN_ORDER = slot(1 if THREADS else 0)  # 1: one thread alone goes through a window in the order of time
STOP_PAIRS = slot(1 if THREADS else 0)  # it stops when its PAIRS are so many
UNDO_ROOM = slot(1 if THREADS else 0)  # old rows that a thread can keep
UNDO_LENGTH = slot(1 if THREADS else 0)
PUT_OFF = slot(1 if THREADS else 0)  # events put off in this round
STAYED = slot(1 if THREADS else 0)  # those of them that were never in the heap
SET_ASIDE = slot(1 if THREADS else 0)  # windows: contacts that go back to their buckets after this round
LATE = slot(1 if THREADS else 0)  # windows: 1 where others may have gone beyond the time of an event
MET = slot(1 if THREADS else 0)  # windows: whom a particle has met whose search was put off; or -1
COMPARING = slot(1 if THREADS else 0)  # windows: 1 while all segments are compared
TILES_AT_WORK = slot(1 if THREADS else 0)  # windows: tiles of the domain at work
WRONG = slot(1 if THREADS else 0)  # 1: this window has to be undone
CHANGED_SINCE = slot(1 if THREADS else 0)  # neighbours that have changed since the time of a prediction
OUTCOME = slot(1 if THREADS else 0)  # why one thread alone stopped within a window
BLIND = slot(1 if THREADS else 0)  # 1, in tests alone: nothing that went wrong is seen
EVENTS_DONE = slot(1 if THREADS else 0)
MEETINGS = slot(1 if THREADS else 0)  # of all threads at the barrier
AGREED = slot(8 if THREADS else 0)  # what all threads told each other after a round, as TOLD says
WINDOWS = slot(1 if THREADS else 0)  # that stand
REDONE = slot(1 if THREADS else 0)  # that were undone
ROUNDS = slot(1 if THREADS else 0)
LEFT_OVER = slot(1 if THREADS else 0)  # events put off, in all rounds
PART = slot()  # what the loop is at, for a look from outside: the index of one of the parts below
COUNTERS = slot.end
FLIGHT_COUNTS = COUNTERS

# What each thread counts by itself.
COUNTED = (PAIRS, WALL_HITS, OUT_OF_ORDER, STALE, REBUILDS, LOGGED) + ((OBSTACLE_HITS,) if OBSTACLES else ())

# Parts of the loop (`hardspheres.breakdown`).
CALENDAR, EXECUTION, PREDICTION, RENEWAL = range(4)

# What is doubled where room ran out.
ROOMS = {
    SHORT_LISTS: [LIST_ROOM, SEGMENT_ROOM, OVERFLOW_ROOM],
    SHORT_CELLS: [CELL_ROOM],
    SHORT_QUEUE: [HEAP_ROOM, BLOCKS, CONTACT_ROOM, NEAR_ROOM],
}

# Threads. What each tells the others after a round, int64.
TOLD = 8
TOLD_PUT_OFF, TOLD_WRONG, TOLD_SHORT, TOLD_REBUILDS, TOLD_PAIRS, TOLD_EVENTS, TOLD_LOGGED, TOLD_OUTCOME = (
    range(8)
)
LINE = 8  # int64 in a line of the cache, which no two threads should write to

# An old row, as it was before an event of this window, 16 float64: the row, whose it is, the one before it.
OLD_ROW = 16
OLD_WHO = 8  # int64; windows: above its 32 bits 1 + another old row from the same cells
OLD_BEFORE = 9  # int64, as `old_rows` of a particle
OLD_FLIGHT = 10  # BEGAN and BEGAN_EPOCH
OLD_FALL = 12  # DIM numbers
OLD_END = 15  # windows: when it was replaced

# Windows on threads, of a particle, by the slot of its segment, int64: its TILE_WORD, as above, and which of
# the overflow lists has, or would have, its segment.
HOME = 2
HOME_LIST = 1
SEARCH_DUE = 1 << 31  # in place of a partner, plus 1 + whom it has met: a search that was put off

ALL_TILES = 4  # in place of a shift: the whole box is one domain

# Flights, where FLIGHTS. Of a particle, float64:
FLIGHT = 4 if FLIGHTS else 0
BEGAN = 0  # when its last collision with another particle was, within the epoch
BEGAN_EPOCH = 1  # that epoch; -1 and a time of a whole epoch at the start: then it has not collided yet
SPECIES = 2  # its species

# Bins of paths and times: 2^OCTAVE_BITS of equal width in each octave of their unit, from 2^LEAST_OCTAVE on;
# the first bin has all that is less, the last all that is more. Speeds: bins of equal width, the last has all
# that is more.
OCTAVE_BITS = 4
LEAST_OCTAVE, OCTAVES = -8, 16
FLIGHT_BINS = (OCTAVES << OCTAVE_BITS) + 2
SPEED_BINS = 129

# What the flights of a species have added up, float64 after the sums: whole numbers, then fractions.
slot = Slots()
FIRST_PATH = slot()  # paths from the start of the simulation to first collisions
HIGHER_MOMENTS = slot(4)  # sums of path^2, path^3, time^2, time^3
SPEED_FLIGHTS = slot(2 * SPEED_BINS)  # sums of path and of free time, by speed
FLIGHT_SUM = slot.end
# Units of these sums in one of PER_PATH or PER_TIME, its square, its cube.
PER_MOMENT = (2.0**11, 2.0**12, 2.0**11)

# How many, int64 after the counters.
slot = Slots()
FIRST_FLIGHTS = slot()  # flights that were under way when the simulation began; they count nowhere else
FLIGHTS_ENDED = slot()
PATH_BINS = slot(FLIGHT_BINS)
TIME_BINS = slot(FLIGHT_BINS)
SPEED_COUNTS = slot(SPEED_BINS)
FLIGHT_COUNT = slot.end
# After the last species: SPECIES_COUNT * SPECIES_COUNT numbers of collisions between species.

# An event in the log, float64.
slot = Slots()
LOG_TIME = slot()  # since the start of the simulation
LOG_FIRST = slot()  # lower and higher id
LOG_SECOND = slot()
LOG_IMPULSE = slot()
LOG_PATHS = slot(2)  # of both
LOG_NORMAL = slot(DIM)
LOG_EPOCH = slot(1 if THREADS else 0)  # from here on: by which the logs of threads are put in order
LOG_MOMENT = slot(1 if THREADS else 0)  # time within the epoch
LOG_ROUND = slot(1 if THREADS else 0)
LOG_ROW = slot.end

# What a checkpoint keeps of the numbers and counters, besides the arrays that `arrays` says. All else follows
# from these and the scene.
STATE_NUMBERS = (NOW, LAST_ADVANCE)
STATE_COUNTERS = (
    *(EPOCH, PAIRS, WALL_HITS, OUT_OF_ORDER, STALE, REBUILDS, INSTANT_EVENTS, LAST_PAIR_EPOCH),
    *((OBSTACLE_HITS,) if OBSTACLES else ()),
)

# A block of a bucket, 8 int64: the next block (-1: none) and how many entries, then 7 entries.
# In the calendar an entry is id << 32 | stamp.
BLOCK = 8
STAMP_BITS = 0xFFFFFFFF
WAITING = 4  # entries that wait for their bucket to come into the cache

LANES = 16  # neighbours that one pass of the prediction handles
CELL_LANES = 16  # reference positions that one step in a cell handles
AROUND = 27 if DIM == 3 else 9  # cells where a particle's neighbours may be
CELL_COLUMNS = DIM + 2 if SIZES else DIM + 1  # of a cell: id, place as seen from its corner, radius

# A predicted contact, 4 int64.
CONTACT = 4
CONTACT_TIME = 0  # bits of its time
CONTACT_PAIR = 1  # lower id << 32 | higher id
CONTACT_VERSIONS = 2  # of both, when the contact was computed

# A segment, 8 float32.
SEGMENT = 8
MIDPOINT = 0  # at the middle of the window
HALF_DISPLACEMENT = 3  # in the window
PADDED_RADIUS = 6  # radius and margin
OWNER = 7  # the particle's id, in the same memory as int32

# The quantised bounding box of a segment, 6 bytes of an int64: the low ends along x, y, z, and the high ends
# negated. Whole turns of 256 are left out: units are such that boxes that overlap, and those that are
# compared, differ by less than half a turn, so that the sign of their difference can be told. The byte after
# them has the numbers of near cells with segments that may overlap this one.
BYTE = 255
NEAR_SHIFT = 48
MAY_REACH_WALL = 1 << 56  # threads: the flight may reach a wall
BEFORE_X, BEFORE_Z, AFTER_X, AFTER_Z = 1, 2, 16, 32  # bits of that byte: one cell
BEFORE_Y, AFTER_Y = 2, 6  # of two bits each: up to three, the first of them

# The image of one segment in which another is compared with it: 1, plus or minus a box, for each axis.
IMAGE = (1, 4, 16)
SAME = 21
CELLS_OF_OVERFLOW = 16  # cells along y that share an overflow list
