"""The static Gaussians' growth and pruning, and how raw parameters of both sets are activated."""
