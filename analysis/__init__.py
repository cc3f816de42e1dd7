"""Estimators: engine tallies and frames in, numbers with error bars beside their theory out."""
