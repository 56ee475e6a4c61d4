"""The halves of a photo: an image's embedding is found on the left one, figures are of the right.

What the right half shows never reaches the embedding: the fit is given the left columns only.
"""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float, Shaped
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.accumulated_weights import accumulated_weights
from desplat_ns.backend.protocol import View
from desplat_ns.cameras.views import reduced, resized, view_of
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.gaussians.activation import activate_static
from desplat_ns.layers import over_background
from desplat_ns.losses import photometric_losses
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.camera_response import fit_response, squared_radius
from desplat_ns.photo_tourism.image_effects import FEATURES

FITTED_PIXELS = 100_000
"""Pixels of which a photo's light is found: the closed form takes so many of the left half, and
Adam reduces photo and rendering by a whole factor, to about so many."""


def right_half(image: Shaped[Tensor, "H W C"]) -> Shaped[Tensor, "H right C"]:
    """Columns [W // 2:] (App. B.1); for odd W the middle column is among them."""
    return image[:, image.shape[1] // 2 :]


def embedding_from_left_half(
    model: DeSplatModel,
    camera: Cameras,
    photo: Float[Tensor, "H W 3"],
    config: EvaluationConfig,
    mask: Shaped[Tensor, "H W 1"] | None = None,
) -> Float[Tensor, " E"]:
    """The embedding that explains the left half of a photo best, by some `FITTED_PIXELS`.

    The model is in eval mode and stays bit-identical. Numbers of a camera's response are found in
    closed form; other embeddings by Adam from the average of the training images' on (B.3). The
    view keeps both halves, as EWA bounds and culls differently at another border (1e-3 of colour);
    Gaussians that the left half does not need are not drawn. What `mask` leaves out does not count.
    """
    view = view_of(camera)
    average = model.image_effects.of(None)
    if model.effects.closed_form:
        left = torch.arange(view.width, device=photo.device) < view.width // 2
        counts = left.expand(view.height, -1)
        if mask is not None:
            counts = counts & (mask[..., 0].to(photo.device) != 0)
        with torch.no_grad():
            static = model.render_static(view, average)
            behind = model.background_of(view, average)
            image = over_background(static.rgb, static.alpha, behind)
        rows = counts.flatten().nonzero()[:, 0]
        order = torch.randperm(len(rows), generator=torch.Generator().manual_seed(0))
        rows = rows[order[:FITTED_PIXELS].sort().values.to(rows.device)]
        parts = (image, photo, squared_radius(view))
        rgb, seen, radius2 = (part.flatten(0, 1)[rows] for part in parts)
        return fit_response(rgb, seen, radius2, average)
    factor = max(1, round(math.sqrt(view.height * view.width / FITTED_PIXELS)))
    smaller = resized(view, (view.width // factor, view.height // factor))
    columns = view.width // 2 * smaller.width // view.width  # whole ones: none sees the right half
    draw = as_function_of_embedding(model, smaller, columns)
    weight = torch.ones_like(photo[..., :1]) if mask is None else (mask != 0).to(photo)
    target = photo * weight
    if factor > 1:
        size = smaller.width, smaller.height
        target, weight = reduced(target, size), reduced(weight, size)
    target, weight = target[:, :columns], weight[:, :columns]
    with torch.enable_grad():
        embedding = average.detach().clone().requires_grad_()
        optimizer = torch.optim.Adam([embedding], lr=config.learning_rate)
        for _ in range(config.steps):
            drawn = draw(embedding)[:, :columns] * weight
            (loss,) = photometric_losses(target, None, model.config.ssim_lambda, drawn)
            (embedding.grad,) = torch.autograd.grad(loss, embedding)  # nothing else gets one
            optimizer.step()
    return embedding.detach()


def as_function_of_embedding(
    model: DeSplatModel, view: View, columns: int
) -> Callable[[Float[Tensor, " E"]], Float[Tensor, "H W 3"]]:
    """The static scene seen from `view`, given an image embedding; all else is held constant.

    Only so many of the first columns are right: Gaussians that they do not show are left out. Where
    such a Gaussian ended the blending of a pixel unseen, what lies behind then shows, by
    TRANSMITTANCE_MIN / (1 - ALPHA_MAX) at most.
    """
    params = {name: value.detach() for name, value in model.params_in(view).items()}
    settings = model.render_settings(depth=False)
    splats = activate_static(params, model.active_sh_degree)
    weights = accumulated_weights(model.rasterizer, splats, view, settings, columns)
    params = {name: value[weights > 0] for name, value in params.items()}
    lit = model.in_light(params, view)
    drawn = None

    def draw(embedding: Tensor) -> Tensor:
        nonlocal drawn
        if drawn is None or FEATURES in params:
            drawn = model.rasterizer(lit(embedding), view, settings)
        background = model.background_of(view, embedding)
        return model.image_of(drawn, background, view, embedding).clamp(0, 1)

    return draw
