"""How kernels are compiled: strict arithmetic, raw pointers, vector instructions."""
