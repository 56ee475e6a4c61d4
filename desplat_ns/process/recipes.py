"""The numbers of the two ways to match and map: the cheap one, and the one where that fails."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Recipe:
    """How features are found, matched and mapped."""

    name: str
    longest_side: int
    """Pixels at which features are looked for; 0: those of the photo."""
    most_features: int
    """Of each photo, the largest ones."""
    peak_threshold: float
    """Of differences of Gaussians; COLMAP's is 0.0067. Lower finds fainter features."""
    domain_size_pooling: bool
    """Descriptors averaged over ten sizes of their patch: slower, and truer on gloss."""
    affine_shape: bool
    """Whether the patch of a feature is an ellipse that fits what is seen from aside."""
    guided: bool
    """Whether matches are looked for again along the epipolar lines of the first ones."""
    pose_inliers: int
    """Matches that a photo's pose needs at least; COLMAP's is 30."""
    neighbours: int
    """Photos that each is matched with, where not all pairs are."""
    filter_error: float | None
    """Pixels of reprojection above which observations go at the end, before the last adjustment."""
    filter_angle: float | None
    """Degrees between the rays to a point below which it goes."""


PLAIN = Recipe("plain", 1000, 4096, 0.02 / 3, False, False, False, 30, 20, None, None)
"""Enough for most captures: photos with structure, taken close to one another."""

THOROUGH = Recipe("thorough", 0, 8192, 0.002, True, True, True, 15, 40, 2.5, 2.0)
"""For gloss, bare walls and far views. Measured on 44 photos of a glossy thing, of which plain
features at 960 pixels pose 11 and 12 apart: a lower threshold at full size poses 42, pooling and
guided matching with a filter at 2.5 pixels and 2 degrees all 44. On ten tourists' photos of 480
pixels pooling without affine shapes poses 7; with both all ten, within 1% of the known centres."""
