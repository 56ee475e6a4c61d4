"""What a run is made of: schedules, optimizers that skip unsound steps, checkpoints, resume."""
