"""What a run is made of: losses, schedules, guards against NaN, checkpoints, resume.

May import `gaussians`, `backend`, `files`, `console` and `errors`.
"""
