"""Live localization in a map of images; a map can be opened from its folder alone."""
