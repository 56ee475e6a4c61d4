"""One training step's look at one training view, and what it proposes to remember."""

from __future__ import annotations

from dataclasses import dataclass, field

from jaxtyping import Bool, Float
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.separation.expected_residual import UsualResiduals
from desplat_ns.separation.failure_cases import Sight


@dataclass(repr=False)
class Visit:
    """One training view in one training step, from its rendering to the optimizers' step.

    It is made when the view is drawn and filled in when the loss is computed. Nothing that it holds
    has an effect beyond the step until the optimizers have stepped: an unsound step is undone by
    throwing its visit away.
    """

    index: int
    """Number of the training view."""
    view: View
    static: Rendering
    """The static scene."""
    distractors: Rendering | None = None
    """The view's own distractors; None if none were drawn."""

    photo: Float[Tensor, "H W 3"] = field(init=False)
    """What the view should look like, in [0, 1]."""
    static_rgb: Float[Tensor, "H W 3"] = field(init=False)
    """The static scene as an image, over the background."""
    alpha_d: Float[Tensor, "H W 1"] = field(init=False)
    """Opacity of the distractors."""
    mask: Bool[Tensor, "H W 1"] | None = None
    """The user's, True in the pixels that count; None if there is none."""

    standing: Bool[Tensor, "rows columns"] | None = None
    """Regions that stay with less evidence at the view's next visit, on the grid of `grid_of`; None
    where none is to be remembered."""
    inside: Bool[Tensor, "rows columns"] | None = None
    """Where distractors belong, on the grid of `grid_of`; None if the view is not to get any."""
    left_out: Bool[Tensor, "rows columns"] | None = None
    """Regions that the static scene's own loss leaves out; None for none."""
    learned: UsualResiduals | None = None
    """What the static Gaussians are to remember of the view; None for nothing."""
    sight: Sight | None = None
    """Where distractors cover the view; None if that is not to be watched yet."""
