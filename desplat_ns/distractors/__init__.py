"""The distractor Gaussians: each photo's set, its settings, where they are placed and refined."""
