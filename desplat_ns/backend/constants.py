"""Numbers that every backend shares, each with its reason."""

ALPHA_CUTOFF = 1.0 / 255.0
"""A Gaussian with less opacity at a pixel is skipped there: below one step of an 8-bit image."""

ALPHA_MAX = 0.999
"""Opacity of one Gaussian at one pixel is clamped here, forward and backward, so that
1 / (1 - alpha) stays bounded. gsplat 1.4 and 1.5 use this value."""

TRANSMITTANCE_MIN = 1e-4
"""Blending stops before the Gaussian that would bring the transmittance down to this value, or
below (gsplat)."""

DET_MIN = 1e-10
"""2D covariances with a determinant (pixels^4) at or below this, after the low-pass, are culled:
gradients divide by its square. The low-pass of 0.3 alone leaves 0.09."""
