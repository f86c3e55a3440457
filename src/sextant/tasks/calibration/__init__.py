"""Camera calibration from one image (chapter 2): module and report."""
