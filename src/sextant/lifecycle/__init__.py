"""The life of a run: claim, train, test, evaluate."""
