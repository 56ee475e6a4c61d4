"""Numbers that every backend shares, each with its reason."""

ALPHA_CUTOFF = 1.0 / 255.0
"""A Gaussian with less opacity at a pixel is skipped there: below one step of an 8-bit image."""

ALPHA_MAX = 0.999
"""Opacity of one Gaussian at one pixel is clamped here, forward and backward, so that
1 / (1 - alpha) stays bounded. gsplat's value."""

TRANSMITTANCE_MIN = 1e-4
"""Blending stops before the Gaussian that would bring the transmittance down to this value, or
below (gsplat)."""

NEAR_PLANE, FAR_PLANE = 0.01, 1e10
"""World units; what lies nearer or further off is culled. nerfstudio's and gsplat's values."""

EPS2D = 0.3
"""Pixels^2, added to the diagonal of the 2D covariance (EWA low-pass; 3DGS, gsplat). Its square is
the least determinant that there is, and gradients divide by the determinant's square."""
