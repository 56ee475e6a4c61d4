"""Scores of images and masks, by one of several protocols, and what a report says beside them."""
