"""Figures of the studies that ask about a gas: one style, and one file per study with the panels that it draws.

In reading order: `style`, `pressure` and `pressure_suite`, `free_path`, `diffusion`, `mixture`,
`thermalisation` (its moving gas too).
"""
