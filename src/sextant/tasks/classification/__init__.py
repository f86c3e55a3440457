"""Image classification under corruptions (chapter 7): module and report."""
