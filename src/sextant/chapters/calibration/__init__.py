"""From photos of any kind to their cameras, with everything that can be said of them."""
