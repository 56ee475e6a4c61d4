"""What a run is made of: schedules, optimizers that step if a step is sound, checkpoints, resume."""
