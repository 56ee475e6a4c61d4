"""Decides whose pixel it is: the static scene's, or the photo's own distractors'. Nothing here
changes a Gaussian."""
