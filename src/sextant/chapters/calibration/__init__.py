"""Single-image camera calibration (chapter 2): from photos of any kind to their cameras."""
