"""What describes an image's light: a row of numbers for each training photo."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

INITIAL_STD = 0.01
"""Standard deviation of the embeddings at the start: nearly alike, but not equal."""


class ImageTable(nn.Module):
    """A row of numbers for each training image, as one dense parameter.

    Dense, as torch's embeddings are: Adam moves a row on by its momentum after the step that saw
    the image, so a visit counts for some ten steps of the learning rate. B.3's rate is made for it.
    """

    def __init__(self, start: Float[Tensor, "V E"]):
        """Args:
        start: the rows at the start.
        """
        super().__init__()
        self.weight = nn.Parameter(start)

    def of(self, image: int) -> Float[Tensor, " E"]:
        """The row of a training image."""
        return self.weight[image]

    def mean(self) -> Float[Tensor, " E"]:
        """The training images' average light: that of an image that was not trained on."""
        return self.weight.mean(dim=0)


def image_embeddings(num_images: int, dim: int) -> ImageTable:
    """The e_j that the networks of appearance and background read; drawn from torch's generator."""
    return ImageTable(INITIAL_STD * torch.randn(num_images, dim))
