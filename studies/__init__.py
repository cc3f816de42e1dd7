"""What a person runs: scene, run, analysis, report."""
