"""How fast and how exact the rasterizers are, and what one training step costs: `make bench`."""
