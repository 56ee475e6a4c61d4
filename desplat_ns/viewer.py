"""What the viewer shows: the static scene, or one training view's distractors with it, at first
as the first training photo was taken."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import viser
from jaxtyping import Float
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.viewer.viewer import VISER_NERFSTUDIO_SCALE_RATIO, Viewer
from nerfstudio.viewer.viewer_elements import ViewerControl, ViewerDropdown
from torch import Tensor, nn
from viser import transforms

LAYERS = ("static", "composite", "distractors", "mask")
"""What may stand in the viewer's `rgb`; the first one at the start."""


class LayerControl(nn.Module):
    """Controls in the viewer's "Custom Elements": which layer, and whose distractors.

    Without a viewer it does nothing. nerfstudio 1.1.5 finds controls that are attributes of the
    pipeline's modules.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """`names`: of the training views with distractors; none for no controls."""
        super().__init__()
        self.names = list(names)
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
        if self._suspended or not self.names or self.layer.value == "static":
            return None
        return self.names.index(self.view.value)

    def chosen(self, outputs: dict[str, Tensor]) -> dict[str, Tensor]:
        """The same outputs with the chosen layer as `rgb`.

        Reads rgb_composite and rgb_distractor, both [H, W, 3], and distractor_mask [H, W, 1].
        """
        if self.train_idx() is None:
            return outputs
        composite = outputs["rgb_composite"]
        chosen = {
            "composite": composite,
            "distractors": outputs["rgb_distractor"].clamp(0.0, 1.0),
            "mask": outputs["distractor_mask"].to(composite).expand_as(composite),
        }
        return {**outputs, "rgb": chosen[self.layer.value]}


class FirstPhotoView(ViewerControl):
    """Lets every browser that opens the viewer begin at the first training photo's camera.

    nerfstudio 1.1.5 leaves that to viser, which begins outside of the scene, above its corner. It
    calls `_setup` of the controls that it finds among the pipeline's attributes.
    """

    def __init__(self, cameras: Cameras) -> None:
        """From the cameras of the training photos."""
        camera = cameras[0:1]
        pose = camera.camera_to_worlds[0].detach().cpu().double().numpy()
        self.position: Float[np.ndarray, "3"] = pose[:, 3] * VISER_NERFSTUDIO_SCALE_RATIO
        """In the viewer's units, ten to one of the scene's."""
        half_turn = transforms.SO3.from_x_radians(np.pi)  # nerfstudio's look along -z with y up
        self.wxyz: Float[np.ndarray, "4"] = (
            transforms.SO3.from_matrix(pose[:, :3]) @ half_turn
        ).wxyz
        """Camera to world, as a quaternion; the camera looks along +z and its y points down."""
        self.fov = float(2 * np.arctan(camera.height.item() / (2 * camera.fy.item())))
        """From top to bottom, in radians."""

    def _setup(self, viewer: Viewer) -> None:
        super()._setup(viewer)
        viewer.viser_server.on_client_connect(self.show)

    def show(self, client: viser.ClientHandle) -> None:
        """Put a browser's camera where the photo was taken; it can be moved from there."""
        with client.atomic():
            client.camera.position = self.position
            client.camera.wxyz = self.wxyz
            client.camera.fov = self.fov
