"""Recognition and detection by COSFIRE filters configured from one example (chapter 6)."""
