"""Scores images and masks, by one of several protocols, for the report of `ns-eval`."""
