"""Reads captures: reconstructions, photos, masks, and which photos train and which are held out.

COLMAP's models (`colmap_model`) and transforms.json are read into a `reconstruction`; `poses` makes
cameras and points of it. `layouts` recognises which parser reads a folder.
"""
