"""Figures of the physics studies: one style, and one file per study with its panels.

In reading order: `style`, `pressure` and `pressure_suite`, `free_path`, `diffusion`, `mixture`,
`thermalisation` (its moving gas too).
"""
