"""Localization in a map of images, live; maps open from their folder alone."""
