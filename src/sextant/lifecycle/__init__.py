"""The life cycle of runs and sweeps: claim, train, test, evaluate, report. ``library`` holds the public calls."""
