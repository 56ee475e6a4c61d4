"""Decides whose pixel it is: the static scene's, or the photo's own distractors'.

Finds what stands in the way in a photo, puts distractors there, and keeps the static scene from
learning it.
"""
