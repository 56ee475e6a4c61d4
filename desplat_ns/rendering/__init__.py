"""Turns cameras into views, and rendered layers into the images that the model gives.

May import `backend`.
"""
