"""Reads captures: reconstructions, photos, masks, and which photos train and which are held out.

May import `console`, `cores` and `errors`.
"""
