"""Weather: snow, frost, fog, sunlight, spatter, and the textures they are made from."""
