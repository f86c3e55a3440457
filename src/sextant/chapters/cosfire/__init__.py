"""Recognition by COSFIRE filters (chapter 6): module, methods and report."""
