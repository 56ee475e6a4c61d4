"""Captures on disk: reconstructions, photos, and which photos train and which are held out."""
