"""Validation: the accuracy of the engine and of the estimators, measured.

In reading order:

- `hard_cases/`: scenes with an exact answer, one file per group of cases;
- `accuracy`: speed against error beside two time-stepping programs (`time_stepping`); the trajectory of few
  particles against 50 digits (`oracle`, `accuracy_few`), the pressure and mean free path of many
  (`accuracy_long`), conclusions from both (`accuracy_answer`), the figure (`accuracy_figure`);
- `calibration`: the error bars of every estimator, over many short runs (`calibration_runs`,
  `calibration_figure`);
- `verify`: this machine beside the package, in under a minute (`golden`: the digests; `processor`);
- `soak`: 1e9 collisions, and the quantities that must not change.
"""
