"""A run: nerfstudio's trainer, pipeline and data manager, resuming, the guard, the clock."""
