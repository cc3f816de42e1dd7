"""What the scene has: constants of one kind of scene, set by `kernel.specialise`; these are defaults."""

DIM = 3  # dimension of space, 2 or 3
WALLS = False  # some axis lies between walls
SIZES = False  # radii differ
MASSES = False  # masses differ
SPARSE = False  # dilute: common windows of time in place of neighbour lists
GROWS = False  # all radii grow linearly in time (never with SPARSE)
OBSTACLES = False  # some particles have infinite mass and stay where they are (with MASSES only)
GRAVITY = False  # all that move fall with the same acceleration (never with GROWS; OBSTACLES: not SPARSE)
HEAT = False  # the heat flux is tallied (never with GROWS, GRAVITY or OBSTACLES)
FLIGHTS = False  # free flights are tallied, and events logged if there is a log (never with GROWS)
THREADS = False  # one gas on several threads (never with GROWS)
