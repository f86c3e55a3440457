"""Where registered models of earlier releases find what they import; nothing else uses it."""
