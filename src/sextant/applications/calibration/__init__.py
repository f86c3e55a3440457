"""Photos of any kind to their cameras, with all that can be said of them."""
