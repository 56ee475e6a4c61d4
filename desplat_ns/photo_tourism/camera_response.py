"""What a camera makes of the scene's colours: the cheapest grade of appearance.

A photo's exposure, white balance, contrast and vignetting are five numbers for the whole image,
applied to the finished picture of the static scene. Distractors lie in front of it, in their own
colours. Letters in shapes: H x W pixels, P pixels in a list, V photos.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor
from torch.func import jvp

from desplat_ns.backend.protocol import View

NUMBERS = 5
"""Of one photo: the logarithms of a gain for red, green and blue, that of gamma, and vignetting."""

CENTRED = 4
"""As many of them have the mean 0 over the training photos. Else a gain of all photos together
could stand for the scene's own colours. Vignetting cannot: points move across the picture."""

FLOOR = 1 / 255
"""Added to colours before they are raised to gamma, so that the slope at black is finite."""

FIT_ROUNDS = 20
"""Gauss-Newton steps of `fit_response`."""

OUTLIER = 0.08
"""Colour difference at which a pixel counts a quarter in the last steps of `fit_response`: what
stands in front of the scene must not set its light."""

PRIOR_STD = (0.2, 0.2, 0.2, 0.1, 0.1)
"""Standard deviations of the numbers over the photos of a capture, about their mean: their prior.
The mean is free: a lens darkens the corners of all photos alike."""

OBSERVATIONS = 12
"""Independent errors that the pixels of a photo count for beside the prior of a fit: errors come in
patches."""


def squared_radius(view: View) -> Float[Tensor, "H W 1"]:
    """Squared distance of each pixel from the principal point, over that of half the diagonal."""
    like = view.K
    x = torch.arange(view.width, device=like.device, dtype=like.dtype) + 0.5 - view.K[0, 2]
    y = torch.arange(view.height, device=like.device, dtype=like.dtype) + 0.5 - view.K[1, 2]
    scale = 4 / (view.width**2 + view.height**2)
    return scale * (x.square()[None, :, None] + y.square()[:, None, None])


def camera_response(
    rgb: Float[Tensor, "*#pixels 3"],
    numbers: Float[Tensor, "*P 5"],
    radius2: Float[Tensor, "*#pixels 1"],
) -> Float[Tensor, "... 3"]:
    """gain exp(v r^2) ((c + f)^gamma - f^gamma), channel by channel: c where all numbers are 0.

    f is `FLOOR`, r the distance from the principal point. Colours are those of the photo's file,
    not of linear light, in which gain and gamma have the same form with other values.

    Args:
        rgb: colours >= 0; 1 is the brightest that an average photo shows.
        numbers: log gain of each channel, log gamma, v; in a list also those of each pixel's photo.
        radius2: of `squared_radius`.
    """
    # A gradient summed by columns first has the same bits for any number of torch's threads.
    numbers = numbers.expand(radius2.shape[-2], NUMBERS)
    gamma = numbers[:, 3:4].exp()
    toned = torch.exp(gamma * torch.log(rgb + FLOOR)) - torch.exp(gamma * math.log(FLOOR))
    return toned * torch.exp(numbers[:, :3] + numbers[:, 4:] * radius2)


def scene_colors(
    shown: Float[Tensor, "P 3"], numbers: Float[Tensor, "*P 5"], radius2: Float[Tensor, "P 1"]
) -> Float[Tensor, "P 3"]:
    """The inverse of `camera_response`, by the numbers of a photo or of each pixel's."""
    gamma = numbers[..., 3:4].exp()
    toned = shown * torch.exp(-numbers[..., :3] - numbers[..., 4:] * radius2)
    return (toned + torch.exp(gamma * math.log(FLOOR))) ** (1 / gamma) - FLOOR


def response_step(
    numbers: Float[Tensor, " 5"],
    rgb: Float[Tensor, "P 3"],
    photo: Float[Tensor, "P 3"],
    radius2: Float[Tensor, "P 1"],
    weight: Float[Tensor, "P 3"],
    prior: Float[Tensor, "5 5"],
    mean: Float[Tensor, " 5"],
) -> Float[Tensor, " 5"]:
    """The numbers after a step of Gauss-Newton to those with which the scene's colours come closest
    to a photo's. Everything is in double precision.

    Args:
        weight: of the squared differences.
        prior: weight of the products of what the numbers differ from `mean`.
    """
    unit = torch.eye(NUMBERS).to(rgb)
    image, by_gamma = jvp(lambda n: camera_response(rgb, n, radius2), (numbers,), (unit[3],))[:2]
    by_gain = (image * channel for channel in unit[:3, :3])
    slopes = torch.stack([*by_gain, by_gamma, image * radius2], dim=-1).reshape(-1, NUMBERS)
    weighted = weight.reshape(-1, 1) * slopes
    wanted = weighted.T @ (photo - image).reshape(-1) - prior @ (numbers - mean)
    step = torch.linalg.solve(slopes.T @ weighted + prior, wanted)
    return (numbers + step.clamp(-0.5, 0.5)).clamp(-3, 3)


@torch.no_grad()
def fit_response(
    rgb: Float[Tensor, "P 3"],
    photo: Float[Tensor, "P 3"],
    radius2: Float[Tensor, "P 1"],
    mean: Float[Tensor, " 5"],
) -> Float[Tensor, " 5"]:
    """The numbers with which the scene's colours (>= 0) come closest to a photo's (in [0, 1]); what
    the pixels do not tell stays at the `mean` of the capture's photos.

    Gauss-Newton from the mean on the Geman-McClure loss of the differences. Its scale shrinks from
    step to step, from ten times `OUTLIER`, for large changes of exposure, and once more from
    `OUTLIER` itself, for something large in front; the better end counts. Pixels in which the photo
    is at the end of its range are left out. The prior `PRIOR_STD` weighs by the differences'
    variance: what a scene has not learned is no light of the photo.
    """
    rgb, photo, radius2, mean = (part.double() for part in (rgb, photo, radius2, mean))
    in_range = ((photo > FLOOR) & (photo < 1 - FLOOR)).all(dim=-1)
    rgb, photo, radius2 = rgb[in_range], photo[in_range], radius2[in_range]
    if len(rgb) == 0:
        return mean.float()
    prior = len(rgb) / OBSERVATIONS * torch.tensor(PRIOR_STD).to(rgb).pow(-2).diag()

    def fitted(widest: float) -> tuple[float, Tensor]:
        numbers, loss = mean, rgb.new_zeros(())
        for i in range(FIT_ROUNDS + 1):
            scale = OUTLIER * max(1.0, widest * 0.75**i)
            error = photo - camera_response(rgb, numbers, radius2)
            share = (1 + (error / scale).square()).reciprocal()
            ridge = prior * (1.4826 * error.abs().median()).clamp(min=FLOOR).square()
            off = numbers - mean
            loss = (1 - share).sum() + off @ ridge @ off / scale**2
            if i == FIT_ROUNDS:
                break
            numbers = response_step(numbers, rgb, photo, radius2, share.square(), ridge, mean)
        return float(loss), numbers

    return min((fitted(widest) for widest in (10.0, 1.0)), key=lambda end: end[0])[1].float()
