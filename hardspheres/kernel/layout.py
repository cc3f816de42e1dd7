"""The slots of the engine's flat arrays, by name."""

from hardspheres.kernel.arrays import Arrays  # noqa: F401

from .flags import DIM, FLIGHTS, SIZES, SPARSE

# A particle's row, 8 float64 (one cache line): the canonical state. One more row, of NaN, is the null
# particle, which collides with nothing.
ROW = 8
X = 0  # position when the row was last written, DIM numbers
V = DIM  # velocity, DIM numbers
T = 2 * DIM  # when that was, relative to the epoch
RADIUS = 7

# A particle's next event, 8 int64 (one cache line); TIME and REFERENCE hold float64 bits. Windows need none.
EVENT = 0 if SPARSE else 8
TIME = 0
PARTNER = 1  # a particle, n + 2 axis + side for a wall, or one of the codes below
PARTNER_VERSION = 2  # the partner's version when the event was predicted
STAMP = 3  # of the one queue entry that counts
REFERENCE = 4  # reference position of the particle's list (unwrapped as the row), DIM numbers

REBUILD = -1  # the particle is at its displacement threshold: a new neighbour list is due
NOTHING = -2  # no event before the epoch ends

# Numbers, float64.
BOX = 0  # edge lengths, 3 slots
INVERSE = 3  # 1/edge on periodic axes, 0 on wall axes
EPOCH_LENGTH = 6  # length of an epoch in time
DISPLACEMENT_THRESHOLD = 7  # how far a particle may go from REFERENCE before its list is rebuilt
CUTOFF = 8  # neighbours' reference positions are closer (plus both radii, where radii differ)
SIGMA2 = 9  # squared contact distance, where all radii are equal
COMMON_RADIUS = 10  # radius, where all radii are equal
REDUCED = 11  # reduced mass of a pair, where all masses are equal
MASS = 12  # mass, where all are equal
INVERSE_WIDTH = 13  # 1/width of a calendar bucket
CELL_DENSITY = 14  # cells per length, 3 slots
NOW = 17  # time of the last event, relative to the epoch
ORDER_TOLERANCE = 18  # an event is out of order if predicted more than this before NOW
LAST_ADVANCE = 19  # NOW when time last advanced
HALF_WINDOW = 20  # windows: half their length in time
HALF_LENGTH = 21  # how far a segment reaches from its middle, at most
SEGMENT_UNIT = 22  # 1 / the longest edge of a cell
SEGMENT_MARGIN = 23  # added to the radius, for rounding
CELL_EDGE = 24  # edges of a cell, 3 slots
MIDDLE = 27  # time at the middle of the window
SCALE = 28  # growth: at the epoch's start all radii are this many times those given
GROWTH = 29  # how much that grows in a unit of time
SMALL_RADIUS = 30  # windows: particles with a larger radius are in the coarse grid
LARGEST = 31  # largest radius
LARGE_DENSITY = 32  # coarse cells per length, 3 slots
MEAN_SQUARE = 35  # mean square speed when this epoch began, where masses differ
UPPER_MEAN_SQUARE = 36  # from this mean square speed on epochs are too long
LOWER_MEAN_SQUARE = 37  # below this one they are too short
UNIT_DENSITY = 38  # windows: units of bounding boxes per length, 3 slots
SEGMENT_OVERHANG = 41  # how far a segment may reach beyond its cell, 3 slots
LEAD = 44  # lists: how far in time a reference position is ahead of its particle
NUMBERS = 45
FLIGHT_UNITS = NUMBERS  # where FLIGHTS, of each species: 1 / the units of its paths, times, and bins of speed

# Sums since the tallies were reset, float64.
VIRIAL = 0  # sum of r_a dp_b over pair collisions: xx, yy, zz, xy, xz, yz
STRESS = 6  # sum of d(m v_a v_b) over events, same order; with its moment: the integral of the kinetic part
STRESS_MOMENT = 12  # sum of (time within the epoch) d(m v_a v_b)
STRESS_EPOCHS = 18  # sum of (epoch) d(m v_a v_b) of earlier epochs
WALL_IMPULSE = 24  # momentum given to the wall, per axis: lower, upper
WALL_RADIUS_IMPULSE = 30  # the same times the particle's radius
SUMS = 36  # how many begin anew with the tallies
LEDGER = (
    36  # net momentum given to the walls since the start, 3 slots: it stays small and so exact to rounding
)

# Counters, int64.
N = 0
CELLS = 1  # cells per axis, 3 slots
CELL_ROOM = 4  # particles that a cell can hold
LIST_ROOM = 5  # slots in a neighbour list, a multiple of LANES
IMAGES = 6  # 1: lists store the image index, as the nearest image may not be the one meant
BUCKETS = 7  # buckets in a cycle of the calendar, a power of two
BUCKET = 8  # the calendar's current bucket, counted from the epoch's start
EPOCH = 9
PAIRS = 10  # pair collisions
WALL_HITS = 11
OUT_OF_ORDER = 12
STALE = 13
REBUILDS = 14
INSTANT_EVENTS = 15  # events at one instant: since time last advanced
FREE_BLOCK = 16  # head of the list of free blocks
HEAP_LENGTH = 18
HEAP_ROOM = 19
SHORT_LISTS = 20  # set where room ran out: the run stops, makes room, and searches again from the rows
SHORT_CELLS = 21
SHORT_QUEUE = 22
LAST_PAIR_EPOCH = 23  # epoch of the last pair collision
WINDOW_BUCKETS = 24  # buckets in a window; 0 for lists
SEGMENT_ROOM = 25  # windows: segments that the cells can hold
OVERFLOWED = 26  # new segments of this window in overflow lists
REGISTERED = 27  # segments at the beginning of this window
CONTACT_ROOM = 28
CONTACTS = 29  # contacts predicted in this window
OVERFLOW_ROOM = 30
EPOCH_BUCKETS = 33  # buckets in an epoch
LARGE = 34  # windows: how many particles are in the coarse grid
LARGE_CELLS = 35  # coarse cells per axis, 3 slots
BEYOND_CACHE = 38  # 1: the gas is larger than a core's caches, so what is needed soon is fetched ahead
LOGGED = 39  # events in the log's buffer
LOG_ROOM = 40  # how many it can hold; 0: there is no log
SPECIES_COUNT = 41  # species that flights are told apart by
NEAR_ROOM = 31  # windows: pairs with overlapping bounding boxes that the table can hold
WIDTH = 42  # of a cell in the units of bounding boxes, 3 slots
OVERHANG = 45  # how far a segment may reach beyond its cell in these units, 3 slots
REBUILD_THRESHOLD = 48  # lists: single rebuilds after which all are rebuilt at once
REBUILD_ALL_DUE = 49  # how many single rebuilds there have been then
REBUILDS_OF_ALL = 50  # how often all lists were rebuilt at once
WAITS = 51  # which of those that wait for their bucket is the next
BEYOND_ALL = 52  # 1: it is larger than those that cores share, too
COUNTERS = 53

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

# What the flights of a species have added up, float64 after the sums.
FLIGHT_SUMS = LEDGER + 3
FIRST_PATH = 0  # paths from the start of the simulation to first collisions
PATHS = 1  # sums of path, its square, its cube
TIMES = 4  # the same of free times
SPEED_PATHS = 7  # sums of path, by speed
SPEED_TIMES = SPEED_PATHS + SPEED_BINS  # sums of free time, by speed
FLIGHT_SUM = SPEED_TIMES + SPEED_BINS

# How many, int64 after the counters.
FLIGHT_COUNTS = COUNTERS
FIRST_FLIGHTS = 0  # flights that were under way when the simulation began; they count nowhere else
FLIGHTS_ENDED = 1
PATH_BINS = 2
TIME_BINS = PATH_BINS + FLIGHT_BINS
SPEED_COUNTS = TIME_BINS + FLIGHT_BINS
FLIGHT_COUNT = SPEED_COUNTS + SPEED_BINS
# After the last species: SPECIES_COUNT * SPECIES_COUNT numbers of collisions between species.

# An event in the log, float64.
LOG_TIME = 0  # since the start of the simulation
LOG_FIRST, LOG_SECOND = 1, 2  # lower and higher id
LOG_IMPULSE = 3
LOG_PATHS = 4  # of both
LOG_NORMAL = 6  # DIM numbers
LOG_ROW = LOG_NORMAL + DIM

# What a checkpoint keeps of the arrays, numbers and counters. All else follows from these and the scene.
# Arrays by their names in a checkpoint.
STATE_ARRAYS = {"row": "row", "turns": "image_counts", "total": "total"} | (
    {"flight": "flight"} if FLIGHTS else {}
)
STATE_NUMBERS = (NOW, LAST_ADVANCE)
STATE_COUNTERS = (EPOCH, PAIRS, WALL_HITS, OUT_OF_ORDER, STALE, REBUILDS, INSTANT_EVENTS, LAST_PAIR_EPOCH)

# A block of a bucket, 8 int64: the next block (-1: none) and how many entries, then 7 entries.
# In the calendar an entry is id << 32 | stamp.
BLOCK = 8
STAMP_BITS = 0xFFFFFFFF
WAITING = 4  # entries that wait for their bucket to come into the cache

CONTACT = 4  # int64 in a predicted contact
CELLS_OF_OVERFLOW = 16  # windows: cells along y that share an overflow list
# The image of one segment in which another is compared with it: 1, plus or minus a box, for each axis.
IMAGE = (1, 4, 16)
SAME = 21

LANES = 16  # neighbours that one pass of the prediction handles
CELL_LANES = 8  # reference positions that one step in a cell handles
AROUND = 27 if DIM == 3 else 9  # cells where a particle's neighbours may be
CELL_COLUMNS = DIM + 2 if SIZES else DIM + 1  # of a cell: id, place as seen from its corner, radius

# A predicted contact.
CONTACT_TIME = 0  # bits of its time
CONTACT_PAIR = 1  # lower id << 32 | higher id
CONTACT_VERSIONS = 2  # of both, when the contact was computed

SEGMENT = 8  # float32 in a segment
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
BEFORE_X, BEFORE_Z, AFTER_X, AFTER_Z = 1, 2, 16, 32  # bits of that byte: one cell
BEFORE_Y, AFTER_Y = 2, 6  # of two bits each: up to three, the first of them
