"""Settings that every test shares."""

from hypothesis import settings

settings.register_profile("hardspheres", derandomize=True, deadline=None, print_blob=True)
settings.load_profile("hardspheres")
