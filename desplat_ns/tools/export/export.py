"""From a run to a file of splats: loads it, gathers, writes, says what was written."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.cameras.views import resized, view_of
from desplat_ns.core.console import announce
from desplat_ns.core.errors import ConfigError
from desplat_ns.core.run_files import RunFiles
from desplat_ns.core.whole import plain_errors, write_whole
from desplat_ns.data.training_views import even_subset
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.shown_light import light_of
from desplat_ns.tools.commands.export import Splats
from desplat_ns.tools.export.allowed_views import allowed_views, seen_by_any
from desplat_ns.tools.export.formats import UPRIGHT, format_of
from desplat_ns.tools.export.ply import ply_bytes
from desplat_ns.tools.export.splat_cloud import (
    SplatCloud,
    baked,
    moved,
    near_zero,
    shown_anywhere,
    similarity_to,
)
from desplat_ns.tools.export.spz import placed, spz_bytes
from desplat_ns.tools.loading import load_run
from desplat_ns.training.pipeline import DeSplatPipeline

WRITERS = {".ply": ply_bytes, ".spz": spz_bytes}
MOST_CROP_VIEWS, SIDE, COVERED = 100, 64, 0.5
"""To find how far cameras look: training views at most, pixels of the longer side of a rendering,
and the opacity from which a pixel shows something at a depth."""


def export_splats(files: RunFiles, asked: Splats) -> None:
    """Write the static Gaussians of a run; say how many, how large, and what was left out. Raises
    as `load_run`, `static_cloud`."""
    output, ending = asked.output, format_of(asked.output)
    pipeline = load_run(files, needs_photos=False).pipeline
    cloud, _ = static_cloud(pipeline, asked.crop, asked.light)
    known = pipeline.datamanager.remembered()
    transform, scale = known["transform"].numpy(), float(known["scale"])
    to_file = similarity_to(asked.frame, transform, scale, UPRIGHT[ending])
    cloud, told = moved(cloud, to_file), list[str]()
    if asked.frame == "capture":
        cloud = near_zero(cloud)
    if ending == ".spz":
        near, left_out = placed(cloud)
        cloud, told = cloud.rows(near), [left_out] * bool(left_out)
    content, beside = WRITERS[ending](cloud), output.with_name(f"{output.name}.offset.txt")
    offset = " ".join(map(str, cloud.offset))
    with plain_errors(output):
        write_whole(output, content)
        beside.unlink(missing_ok=True)
        if offset:
            write_whole(beside, f"{offset}\n".encode())
    megabytes = f"{len(content) / 1e6:.2f} MB"
    announce(f"Saved {output}: {len(cloud)} Gaussians, degree {cloud.degree}, {megabytes}.")
    if pipeline.model.effects.background != "off":
        told.append("The background (the sky) is no Gaussians and is not in the file.")
    if cloud.antialiased and ending != ".spz":
        told.append(
            "The run was trained with `rasterize-mode antialiased`, which this format cannot say: "
            "switch antialiasing on in the viewer, or write .spz."
        )
    if offset:
        told.append(
            f"float32 is too coarse for the capture's coordinates: {output} has them without an "
            f"offset of {offset}, which stands in {beside} and in the comment of a .ply."
        )
    for line in told:
        announce(line, warning=True)


def static_cloud(
    pipeline: DeSplatPipeline, crop: float | None, light: str | None
) -> tuple[SplatCloud, Bool[Tensor, " N"]]:
    """The static Gaussians that a file is to hold, in the coordinates of training, and which of the
    model's they are; says what was left out. Raises ConfigError where nothing is left."""
    model = pipeline.model
    cameras = pipeline.datamanager.train_dataset.cameras.to(pipeline.device)
    with shown_in(model, light), torch.no_grad():
        splats, settings = model.shown_splats(), model.render_settings(depth=False)
        # Other viewers have no near plane: Gaussians right before a camera would be in their way.
        near_plane = model.config.near_plane
        visible = seen_by_any(splats, allowed_views(cameras), model.points, near_plane)
        cloud = baked(splats.rows(visible), settings.antialiased)
        rows = visible & shown_anywhere(splats)
        announce(
            f"Static Gaussians: {model.num_points}; exported: {len(cloud)}; left out because no "
            f"training camera shows them, nor a view half-way between two: {int((~visible).sum())}."
        )
        if crop is None:
            return cloud, rows
        with_depth, kept = model.render_settings(depth=True), np.zeros(len(cloud), bool)
        for index in even_subset(len(cameras), MOST_CROP_VIEWS):
            view = view_of(cameras[index : index + 1])
            reach = reach_of(view, lambda small: model.rasterizer(splats, small, with_depth))
            place = view.center.double().cpu().numpy()
            kept |= np.square(cloud.means - place).sum(axis=1) <= (crop * (reach or 0.0)) ** 2
    if not kept.any():
        raise ConfigError(
            f"--crop {crop:g} leaves none of {len(cloud)} Gaussians. Give a larger number, such as "
            "2; where nothing that the cameras show is solid yet, train longer."
        )
    announce(f"--crop {crop:g} keeps {kept.sum()} of them and leaves out {(~kept).sum()}.")
    rows[rows.clone()] = torch.from_numpy(kept).to(rows.device)
    return cloud.rows(kept), rows


def shown_in(model: DeSplatModel, light: str | None) -> Any:
    """Within, the light that was asked for is shown; without one that which is shown anyway."""
    if not light:
        return nullcontext()
    effects = model.image_effects
    if effects.appearance is None:
        raise ConfigError(
            f"--light is '{light}', but this run has the same light in every photo. Leave it out."
        )
    return model.shown_light.fixed(light_of(light, model.names, effects, "--light"))


def reach_of(view: View, rasterize: Callable[[View], Rendering]) -> float | None:
    """Median depth of what a small version of a view shows, world units; None if that is nothing.
    `rasterize` draws the static scene with its depth."""
    factor = max(view.width, view.height) / SIDE
    width, height = (max(1, round(side / factor)) for side in (view.width, view.height))
    rendering = rasterize(resized(view, (width, height)))
    assert rendering.depth is not None
    depths = rendering.depth[rendering.alpha > COVERED]
    return float(depths.median()) if len(depths) > 0 else None
