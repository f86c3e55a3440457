"""The life of runs and sweeps: claim, train, test, evaluate, report. ``library`` has what ``sextant`` offers."""
