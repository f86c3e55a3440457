"""A walk with a camera that nobody knows: calibrated, straightened and localized in a map of another season."""
