"""Both sets of Gaussians: how they start, are activated, grow and are pruned.

May import `rendering`, `backend`, `settings` and `errors`.
"""
