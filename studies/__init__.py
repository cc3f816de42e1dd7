"""Studies and the command line: scene, run, analysis, report."""
