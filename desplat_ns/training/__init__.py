"""What a run is made of: losses, schedules, guards against NaN, checkpoints, resume."""
