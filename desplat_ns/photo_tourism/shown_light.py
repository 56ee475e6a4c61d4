"""Which training photo's light is shown outside of training: in the viewer, in ns-render, and in
what ns-export writes."""

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import torch
from jaxtyping import Float
from nerfstudio.viewer.viewer_elements import ViewerDropdown
from torch import Tensor

from desplat_ns.core.console import list_names
from desplat_ns.core.errors import ConfigError
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.viewer import ViewerControl

VARIABLE = "DESPLAT_NS_APPEARANCE"
"""Environment variable: `photo.jpg`, or `photo.jpg:0.7,other.jpg:0.3` for a mix of two. (Commands
of nerfstudio's leave no other way to say it.)"""

OWN = "none chosen"
"""What the viewer's choice shows at the start: `VARIABLE`'s image, its own, or the average."""


def mixed_light(
    text: str, names: Sequence[str], lights: ImageEffects, given_by: str = VARIABLE
) -> Float[Tensor, " E"]:
    """The embedding of a text such as `VARIABLE` holds: of a training image, or a mix of some.
    Raises ConfigError, which says what the text was `given_by`, of an image that is not a training
    image, or shares that make no mix."""
    parts: list[tuple[int, float]] = []
    for part in filter(None, text.split(",")):
        name, share = part.strip(), "1"
        if name not in names and ":" in name:
            name, _, share = name.rpartition(":")
        if name not in names:
            raise ConfigError(
                f"{given_by} names '{name}', which is no training image. It takes one of "
                f"{len(names)}: {list_names(names, 5)}."
            )
        try:
            parts.append((names.index(name), float(share)))
        except ValueError:
            parts.append((names.index(name), math.nan))
    total = sum(share for _, share in parts)
    if not 0 < total < math.inf or any(share < 0 for _, share in parts):
        raise ConfigError(
            f"{given_by} is '{text}': the shares of its photos have to be numbers, not negative or "
            f"infinite, nor all zero. Write for example {names[0]}:0.5."
        )
    return torch.stack([share / total * lights.of(index) for index, share in parts]).sum(dim=0)


class ShownLight(ViewerControl):
    """The choice of a light: by the viewer's controls, the environment, or an evaluation."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(names)
        if names:
            hint = "Training image whose light the scene is shown in"
            self.choice: ViewerDropdown[str] = ViewerDropdown(
                "Appearance", OWN, [OWN, *names], hint=hint
            )
        self._fixed: Tensor | None = None

    @contextmanager
    def fixed(self, embedding: Float[Tensor, " E"]) -> Iterator[None]:
        """Within, every image that is drawn outside of training has this embedding."""
        before, self._fixed = self._fixed, embedding
        try:
            yield
        finally:
            self._fixed = before

    def embedding(self, lights: ImageEffects, image: int | None = None) -> Float[Tensor, " E"]:
        """The chosen one; else that of training image `image`; else the average."""
        if self._fixed is not None:
            return self._fixed
        if self.names and not self._suspended:
            if self.choice.value != OWN:
                return lights.of(self.names.index(self.choice.value))
            if text := os.environ.get(VARIABLE):
                return mixed_light(text, self.names, lights)
        return lights.mean() if image is None else lights.of(image)
