"""What is learned: both sets of Gaussians, how they start, are activated, grow and are pruned.

May import `backend` and `rendering`.
"""
