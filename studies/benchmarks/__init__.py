"""Benchmarks: collisions per second, beside another engine in the same run.

In reading order:

- `bench`: one gas timed;
- `gas`: how it is started in equilibrium;
- `clock`: the windows that are timed, memory, the machine;
- `rivals`: what runs in turn with our engine, and `peer`: spheropack;
- `suite`: many gases, a table, and `figure`: its figure;
- `prices`: what walls, gravity, tallies and the like cost; `scaling`: one gas on several threads;
  `summary`: what both write.
"""
