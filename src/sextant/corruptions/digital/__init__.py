"""Digital: contrast, colour, warping and compression, as processing and storage leave them."""
