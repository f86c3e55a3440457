"""Photos looked up in a map of photos."""
