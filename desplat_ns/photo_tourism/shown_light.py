"""Which training photo's light is shown outside of training: in the viewer, in ns-render, and in
what ns-export writes."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from jaxtyping import Float
from nerfstudio.viewer.viewer_elements import ViewerDropdown
from torch import Tensor

from desplat_ns.core.console import list_names
from desplat_ns.core.errors import ConfigError
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.viewer import ViewerControl

VARIABLE = "DESPLAT_NS_APPEARANCE"
"""Environment variable that holds an image's name: nerfstudio's commands leave no other way."""

OWN = "none chosen"
"""What the viewer's choice shows at the start: `VARIABLE`'s image, its own, or the average."""


def light_of(
    name: str, names: Sequence[str], lights: ImageEffects, given_by: str = VARIABLE
) -> Float[Tensor, " E"]:
    """The embedding of a training image. Raises ConfigError, which says what the name was
    `given_by`, where there is no such image."""
    if name not in names:
        raise ConfigError(
            f"{given_by} names '{name}', which is no training image. It takes one of "
            f"{len(names)}: {list_names(names, 5)}."
        )
    return lights.of(names.index(name))


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
            if name := os.environ.get(VARIABLE):
                return light_of(name, self.names, lights)
        return lights.of(image)
