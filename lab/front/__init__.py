"""What accuracy costs in time, and what was tried to have more of it: docs/accuracy-and-time.md."""
