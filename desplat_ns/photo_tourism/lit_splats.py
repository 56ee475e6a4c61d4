"""The static Gaussians as one view shows them in the light of an embedding.

What the view cannot show needs no network and no toning, and what does not depend on the embedding
is worked out once. For a file that holds all colours, see `ImageEffects.apply_appearance`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from desplat_ns.backend.inputs import finite_colors
from desplat_ns.backend.projection import uncut_colors
from desplat_ns.backend.protocol import Splats, View
from desplat_ns.backend.spherical_harmonics import C0
from desplat_ns.photo_tourism.appearance import AffineAppearance, ShAppearance, toned_color
from desplat_ns.rendering.in_view import in_view

Lit = Callable[[Tensor], Splats]
"""From an embedding [E] to the Gaussians in its light; colours out of view mean nothing."""


def lit_splats(
    appearance: AffineAppearance | ShAppearance,
    splats: Splats,
    features: Float[Tensor, "N Z"],
    view: View,
) -> Lit:
    """What is drawn of `view`, as a function of the embedding.

    Args:
        features: z_i.
    """
    if isinstance(appearance, AffineAppearance):
        return _toned_after_evaluation(appearance, splats, features, view)
    splats = as_harmonics(splats)
    rows = in_view(splats, view).nonzero()[:, 0]
    degree = splats.sh_degree
    assert degree is not None

    def lit(embedding: Tensor) -> Splats:
        colors = appearance(embedding, features, splats.colors, degree, rows)
        return replace(splats, colors=colors)

    return lit


def as_harmonics(splats: Splats) -> Splats:
    """Colours without spherical harmonics as zeroth coefficients, which say the same."""
    if splats.sh_degree is not None:
        return splats
    return replace(splats, colors=(splats.colors[:, None] - 0.5) / C0, sh_degree=0)


def _toned_after_evaluation(
    appearance: AffineAppearance,
    splats: Splats,
    features: Float[Tensor, "N Z"],
    view: View,
) -> Lit:
    """Eq. 7 as it stands: three numbers for each Gaussian are toned, not all coefficients."""
    splats = as_harmonics(splats)
    finite = finite_colors(splats.colors)
    shown = in_view(splats, view)
    shown = shown if finite is None else shown & finite
    rows = shown.nonzero()[:, 0]
    colors, zeroth = uncut_colors(splats, view, shown)

    def lit(embedding: Tensor) -> Splats:
        beta, gamma = appearance.tones(embedding, features, zeroth, rows)
        toned = toned_color(colors, gamma, beta).clamp(min=0)
        if finite is not None:  # for the backend to cull them
            toned = toned.masked_fill(~finite[:, None], float("nan"))
        return replace(splats, colors=toned, sh_degree=None)

    return lit
