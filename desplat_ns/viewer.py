"""What the viewer shows: the static scene, or one training view's distractors with it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from nerfstudio.viewer.viewer_elements import ViewerDropdown
from torch import Tensor, nn

LAYERS = ("static", "composite", "distractors", "mask")
"""What may stand in the viewer's `rgb`; the first one at the start."""


class ViewerControl(nn.Module):
    """Controls in the viewer's "Custom Elements"; without a viewer they do nothing. nerfstudio
    1.1.5 finds controls that are attributes of the pipeline's modules."""

    def __init__(self, names: Sequence[str]) -> None:
        """`names`: of the training views to choose from; none for no controls."""
        super().__init__()
        self.names = list(names)
        self._suspended = False

    @contextmanager
    def suspended(self) -> Iterator[None]:
        """Within, nothing is chosen: an evaluation must not depend on an open viewer."""
        before, self._suspended = self._suspended, True
        try:
            yield
        finally:
            self._suspended = before


class LayerControl(ViewerControl):
    """Which layer, and whose distractors."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        if names:
            self.layer: ViewerDropdown[str] = ViewerDropdown(
                "Layer",
                LAYERS[0],
                list(LAYERS),
                hint="What `rgb` shows: the scene without distractors, with those of one training "
                "view, these alone, or where they cover the scene",
            )
            self.view: ViewerDropdown[str] = ViewerDropdown(
                "Distractors of training view",
                self.names[0],
                self.names,
                hint="Each training view has distractors of its own; layers show those of this one",
            )

    def train_idx(self) -> int | None:
        """Training view whose distractors were asked for; None while the static scene is shown."""
        if self._suspended or not self.names or self.layer.value == "static":
            return None
        return self.names.index(self.view.value)

    def chosen(self, outputs: dict[str, Tensor]) -> dict[str, Tensor]:
        """The same outputs with the chosen layer as `rgb`, of rgb_composite and rgb_distractor,
        both [H, W, 3], and distractor_mask [H, W, 1]."""
        if self.train_idx() is None:
            return outputs
        composite = outputs["rgb_composite"]
        chosen = {
            "composite": composite,
            "distractors": outputs["rgb_distractor"].clamp(0.0, 1.0),
            "mask": outputs["distractor_mask"].to(composite).expand_as(composite),
        }
        return {**outputs, "rgb": chosen[self.layer.value]}
