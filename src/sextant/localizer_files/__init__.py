"""What a map keeps beside its model, so that a localizer can be opened from its folder alone."""
