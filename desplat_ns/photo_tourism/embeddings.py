"""What describes an image's light: one embedding for each training photo."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

INITIAL_STD = 0.01
"""Standard deviation of the embeddings at the start: nearly alike, but not equal."""


class ImageEmbeddings(nn.Module):
    """The embeddings e_j of the training images, as one dense parameter.

    Dense, as torch's embeddings are: Adam moves a row on by its momentum after the step that saw
    the image, so a visit counts for some ten steps of the learning rate. B.3's rate is made for it.
    """

    def __init__(self, num_images: int, dim: int):
        """Draw the start from torch's generator.

        Args:
            num_images: training images; 1 for an embedding that all share.
            dim: d_e.
        """
        super().__init__()
        self.weight = nn.Parameter(INITIAL_STD * torch.randn(num_images, dim))

    @property
    def shared(self) -> bool:
        """Whether there is one for all images."""
        return len(self.weight) == 1

    def of(self, image: int) -> Float[Tensor, " dim"]:
        """The embedding of a training image."""
        return self.weight[0 if self.shared else image]

    def mean(self) -> Float[Tensor, " dim"]:
        """The training images' average light: that of an image that was not trained on."""
        return self.weight.mean(dim=0)
