"""What accuracy costs in time, and what was tried to have more of it:
docs/results/accuracy-and-time.md."""
