"""What the scene has: constants of one kind of scene, set by `kernel.specialise`; these are defaults."""

DIM = 3  # dimension of space, 2 or 3
WALLS = False  # some axis lies between walls
SIZES = False  # radii differ
MASSES = False  # masses differ
SPARSE = False  # dilute: common windows of time in place of neighbour lists
GROWS = False  # all radii grow linearly in time (never with SPARSE)
GRAVITY = False  # all particles fall with the same acceleration (never with GROWS)
HEAT = False  # the heat flux is tallied (never with GROWS or GRAVITY)
FLIGHTS = False  # free flights are tallied, and events logged if there is a log (never with GROWS)
