"""Closed forms and tables that measurements are compared with, each with its source and uncertainty.

Units are the caller's: lengths in any unit, temperatures as energies (k_B = 1). d is the dimension, N the
number of particles, sigma a diameter, rho = N/V, eta the packing fraction, s = 2 n_coll / N the collisions
per particle. All functions of packing fraction, speed or s take arrays and return arrays of the same shape.

A theory that is not exact comes as a `Prediction`, a value with a standard uncertainty. Asking for one
outside the range in which it was established gives NaN and a `TheoryRangeWarning`.

One idea per file: `maxwell` velocities at equilibrium, `equilibrium` cumulants and H of N particles, `state`
equations of state, `mixtures`, `collisions` rates and free flights, `flights` the same in mixtures,
`relaxation`, `equal_speeds` and `beams` the way to equilibrium, `spline` what is between the numbers of
tables, `transport` Enskog's coefficients, `sound` its speed and damping, `arrangement` the structure factor,
`expansion` how particles spread from half of a box, `barometer` fluids under gravity, `lyapunov` how fast a
gas forgets, `lorentz` a particle among fixed obstacles, `discs` where they melt, `two_spheres` exact rates of
the smallest gas.
"""

from analysis.theory.arrangement import percus_yevick_structure, structure_limit
from analysis.theory.barometer import Barometer, adsorption, barometric_density, barometric_temperature
from analysis.theory.beams import BeamsRelaxation, boltzmann_beams
from analysis.theory.collisions import (
    collision_rate,
    collision_speed_factor,
    compressibility_from_rate,
    finite_size_collision_rate,
    finite_size_mean_free_path,
    finite_size_mixture_rates,
    free_path_density,
    free_path_moment,
    free_path_survival,
    free_time_density,
    free_time_moment,
    free_time_survival,
    mean_free_path,
    speed_dependent_free_path,
    speed_dependent_rate,
)
from analysis.theory.discs import (
    COEXISTENCE,
    COEXISTENCE_PRESSURE,
    HEXATIC_UP_TO,
    disc_pressure,
    disc_pressures,
)
from analysis.theory.equal_speeds import (
    H_BINS,
    KS_BINS,
    SPEED_LIMIT,
    EqualSpeedsRelaxation,
    boltzmann_equal_speeds,
    equal_speeds_decay_rate,
    finite_size_relaxation,
)
from analysis.theory.equilibrium import (
    cumulant_noise,
    equilibrium_a2,
    equilibrium_a3,
    equilibrium_h,
    ks_floor,
)
from analysis.theory.expansion import spread_entropy, spread_shares, tracer_displacement
from analysis.theory.flights import FreeFlights
from analysis.theory.lorentz import (
    FINITE_HORIZON,
    billiard_lyapunov_exponent,
    lorentz_diffusion,
    lorentz_lyapunov_exponent,
    machta_zwanzig_diffusion,
    santalo_free_path,
)
from analysis.theory.lyapunov import lyapunov_exponent, reversal_horizon
from analysis.theory.maxwell import (
    component_cdf,
    component_pdf,
    energy_cdf,
    energy_pdf,
    energy_share,
    finite_energy_law,
    finite_mean_speed,
    mean_speed,
    speed_cdf,
    speed_pdf,
)
from analysis.theory.mixtures import (
    mixture_collision_rates,
    mixture_compressibility,
    mixture_contact_uncertainty,
    mixture_contact_values,
    mixture_mean_free_paths,
    pairs_of_few,
)
from analysis.theory.prediction import Prediction, TheoryRangeWarning, packing_fraction
from analysis.theory.relaxation import (
    anisotropy_decay,
    anisotropy_rate,
    near_equilibrium_rate,
    sonine_rate,
    temperature_equilibration,
    temperature_equilibration_rate,
)
from analysis.theory.sound import momentum_correlation, sound_damping, sound_speed, virial_correlation
from analysis.theory.state import (
    carnahan_starling,
    compressibility_factor,
    compressibility_slope,
    contact_value,
    fcc_crystal,
    finite_size_compressibility,
    finite_size_shift,
    henderson,
    kolafa_labik_malijevsky,
    virial_coefficients,
    virial_discs,
    virial_series,
)
from analysis.theory.transport import (
    bulk_viscosity,
    enskog_diffusion,
    heat_conductivity,
    mutual_diffusion,
    periodic_diffusion_correction,
    periodic_diffusion_window,
    shear_viscosity,
    velocity_correlation_rate,
)
from analysis.theory.two_spheres import two_sphere_rates

__all__ = [
    "COEXISTENCE",
    "COEXISTENCE_PRESSURE",
    "FINITE_HORIZON",
    "HEXATIC_UP_TO",
    "H_BINS",
    "KS_BINS",
    "SPEED_LIMIT",
    "Barometer",
    "BeamsRelaxation",
    "EqualSpeedsRelaxation",
    "FreeFlights",
    "Prediction",
    "TheoryRangeWarning",
    "adsorption",
    "anisotropy_decay",
    "anisotropy_rate",
    "barometric_density",
    "barometric_temperature",
    "billiard_lyapunov_exponent",
    "boltzmann_beams",
    "boltzmann_equal_speeds",
    "bulk_viscosity",
    "carnahan_starling",
    "collision_rate",
    "collision_speed_factor",
    "component_cdf",
    "component_pdf",
    "compressibility_factor",
    "compressibility_from_rate",
    "compressibility_slope",
    "contact_value",
    "cumulant_noise",
    "disc_pressure",
    "disc_pressures",
    "energy_cdf",
    "energy_pdf",
    "energy_share",
    "enskog_diffusion",
    "equal_speeds_decay_rate",
    "equilibrium_a2",
    "equilibrium_a3",
    "equilibrium_h",
    "fcc_crystal",
    "finite_energy_law",
    "finite_mean_speed",
    "finite_size_collision_rate",
    "finite_size_compressibility",
    "finite_size_mean_free_path",
    "finite_size_mixture_rates",
    "finite_size_relaxation",
    "finite_size_shift",
    "free_path_density",
    "free_path_moment",
    "free_path_survival",
    "free_time_density",
    "free_time_moment",
    "free_time_survival",
    "heat_conductivity",
    "henderson",
    "kolafa_labik_malijevsky",
    "ks_floor",
    "lorentz_diffusion",
    "lorentz_lyapunov_exponent",
    "lyapunov_exponent",
    "machta_zwanzig_diffusion",
    "mean_free_path",
    "mean_speed",
    "mixture_collision_rates",
    "mixture_compressibility",
    "mixture_contact_uncertainty",
    "mixture_contact_values",
    "mixture_mean_free_paths",
    "momentum_correlation",
    "mutual_diffusion",
    "near_equilibrium_rate",
    "packing_fraction",
    "pairs_of_few",
    "percus_yevick_structure",
    "periodic_diffusion_correction",
    "periodic_diffusion_window",
    "reversal_horizon",
    "santalo_free_path",
    "shear_viscosity",
    "sonine_rate",
    "sound_damping",
    "sound_speed",
    "speed_cdf",
    "speed_dependent_free_path",
    "speed_dependent_rate",
    "speed_pdf",
    "spread_entropy",
    "spread_shares",
    "structure_limit",
    "temperature_equilibration",
    "temperature_equilibration_rate",
    "tracer_displacement",
    "two_sphere_rates",
    "velocity_correlation_rate",
    "virial_coefficients",
    "virial_correlation",
    "virial_discs",
    "virial_series",
]
