"""What the viewer shows: the static scene, or one training view's distractors with it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nerfstudio.viewer.viewer_elements import ViewerDropdown, ViewerSlider
from torch import Tensor

LAYERS = ("static", "composite", "distractors", "mask")
"""What may stand in the viewer's `rgb`; the first one at the start."""


class LayerControl:
    """Two controls in the viewer's "Custom Elements": which layer, and whose distractors.

    Without a viewer it does nothing. nerfstudio 1.1.5 looks for controls among the pipeline's
    attributes, so the pipeline shows them as its own `layer` and `training_view`.
    """

    def __init__(self, num_views: int) -> None:
        """Controls for `num_views` training views; for none, they are not shown."""
        self.num_views = num_views
        self.layer: ViewerDropdown[str] = ViewerDropdown(
            "Layer",
            LAYERS[0],
            list(LAYERS),
            hint="What `rgb` shows: the scene without distractors, with those of one training "
            "view, these alone, or where they cover the scene",
        )
        self.view: ViewerSlider[int] = ViewerSlider(
            "Distractors of training view",
            0,
            0,
            max(1, num_views - 1),  # viser wants a range
            1,
            hint="Each training view has distractors of its own; layers show those of this one",
        )
        self._suspended = False

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Within, the control does nothing: an evaluation during training must score the static
        scene, whatever was chosen in an open viewer."""
        before, self._suspended = self._suspended, True
        try:
            yield
        finally:
            self._suspended = before

    def train_idx(self) -> int | None:
        """Training view whose distractors were asked for; None while the static scene is shown."""
        if self._suspended or self.num_views == 0 or self.layer.value == "static":
            return None
        return min(int(self.view.value), self.num_views - 1)

    def apply(self, outputs: dict[str, Tensor]) -> dict[str, Tensor]:
        """The same outputs with the chosen layer as `rgb`.

        Reads rgb_composite and rgb_distractor, both [H, W, 3], and distractor_mask [H, W, 1].
        """
        if self.train_idx() is None:
            return outputs
        return {**outputs, "rgb": _layer(self.layer.value, outputs)}


def _layer(name: str, outputs: dict[str, Tensor]) -> Tensor:
    composite = outputs["rgb_composite"]
    if name == "distractors":
        return outputs["rgb_distractor"].clamp(0.0, 1.0)
    if name == "mask":
        return outputs["distractor_mask"].to(composite).expand_as(composite)
    return composite
