"""Where a camera is: maps of descriptors at known poses, observation models over poses, and filters that use them."""
