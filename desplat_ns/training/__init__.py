"""What keeps a run going.

Losses, schedules, guards against what is not finite, checkpoints, resume.
"""
