"""Turns cameras into views, rendered layers into the images that the model gives, and images into
figures.
"""
