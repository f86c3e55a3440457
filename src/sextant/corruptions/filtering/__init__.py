"""Filtering and sampling of batches, as SciPy, scikit-image and ImageMagick do it one image at a time."""
