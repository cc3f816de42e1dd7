"""One gas on several threads, with the bits of one: see `hardspheres.kernel`."""
