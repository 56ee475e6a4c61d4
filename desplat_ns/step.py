"""One training step as a value, from its images to what is remembered of it."""

from dataclasses import dataclass, field

from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.core.schedule import NominalStep, RunStep


@dataclass(repr=False)
class Step:
    """One training view in one training step: drawn, compared, charged, and committed or not.

    Whatever a step finds lies here until it is committed, and changes nothing before: a step that
    is not finite is undone by throwing it away.
    """

    nominal: NominalStep
    run: RunStep
    index: int
    """Number of the training view."""
    view: View
    static: Rendering
    """The static scene."""
    distractors: Rendering | None = None
    """The view's own distractors; None if none were drawn."""

    photo: Float[Tensor, "H W 3"] = field(init=False)
    """What the view should look like, in [0, 1]; under the user's mask as the static scene."""
    static_rgb: Float[Tensor, "H W 3"] = field(init=False)
    """The static scene as an image, over the background."""
    behind: Float[Tensor, "*background 3"] | None = None
    """The background as the photo shows it, in [0, 1]; None to count what shows it as scene."""
    mask: Bool[Tensor, "H W 1"] | None = None
    """The user's, False in pixels that do not count; None if there is none."""
    in_region: Float[Tensor, "H W 1"] | None = None
    """1 in pixels of regions, 0 in others; None before the view has distractors or regions."""

    regions: Bool[Tensor, "rows columns"] | None = None
    """Where distractors belong, on the grid of `grid_of`; None in the warm-up."""
    residual_medians: Float[Tensor, " N"] | None = None
    """What the static Gaussians are to remember (`medians_in`); None for nothing new."""
    sweep_photo: UInt8[Tensor, "fine_rows fine_columns C"] | None = None
    """What the plane sweep is to keep of the photo (`photo_to_sweep`); None for nothing new."""

    losses: dict[str, Float[Tensor, ""]] = field(default_factory=dict)
    """The terms of the loss, without gradients."""
