"""Whose pixel is it: finds what stands in the way in a photo.

The photo's own distractors get it, and the static scene stops learning it.
"""
