"""Estimators: engine tallies and frames in, numbers with error bars beside their theory out.

`statistics` and `series` make numbers with standard errors, `calibration` tests them; `theory` holds every
closed form; `distributions`, `velocities`, `relaxation` and `temperatures` are about velocities, `pressure`
and `virial_identity` about pressure, `free_path` about flights between collisions, `structure`,
`structure_factor`, `profile` and `order` about places, `transport` about diffusion, `lyapunov` about chaos.
"""
