"""Looking photos up in a map of photos."""
