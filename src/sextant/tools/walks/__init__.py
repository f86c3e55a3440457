"""A walk with an unknown camera: calibrated, straightened and localized in a map of another season."""
