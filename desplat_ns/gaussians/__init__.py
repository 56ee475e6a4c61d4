"""Both sets of Gaussians: how they start, are activated, grow and are pruned."""
