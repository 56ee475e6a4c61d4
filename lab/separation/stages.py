"""One training photo as separation sees it, from the photo to the mask.

python -m lab.separation.stages CONFIG [--view 12]     (config.yml of a run of desplat)
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from PIL import Image
from torch import Tensor

from desplat_ns.core.pages import Shown, over_checkerboard, to_rgb8
from desplat_ns.core.run_files import find_run
from desplat_ns.data.training_views import train_index
from desplat_ns.separation.decide import StaticView, compare, decide
from desplat_ns.separation.grid import fine_grid_of, grid_of, pooled
from desplat_ns.separation.residuals import local_residual, medians_in
from desplat_ns.tools.loading import load_run
from lab import DOCS, parser_of
from lab.separation.passers_by import photo_of
from lab.sheet import sheet

TITLES = ("photo", "static scene", "residual", "excess", "unexplained")
TITLES += ("region", "distractors", "mask")
WHITE = 0.25
"""What is drawn white of residual, excess and unexplained, colours in [0, 1]."""


def stages(model: Any, camera: Any, photo: Float[Tensor, "H W 3"]) -> list[Shown]:
    """The pictures of one training view, in the order of `TITLES`; what nobody knows is black.

    Args:
        camera: of the view, with its number.
        photo: in [0, 1].
    """
    model.eval()
    outputs = model.get_outputs(camera)
    model.config.near_plane = 0.0  # so that all Gaussians are projected
    index = train_index(camera)
    drawn = model.render_static(model.view_of_camera(camera, index), model.embedding_of(None))
    opacities = model.gauss_params["opacities"]
    static = StaticView(
        outputs["rgb_static"],
        outputs["accumulation"],
        None,
        drawn.means2d.detach()[0],
        drawn.visible,
        torch.sigmoid(opacities.detach()[:, 0]),
    )
    residual_medians = medians_in(model.strategy_state, len(opacities), photo.device)
    comparison, _ = compare(photo, static, residual_medians)
    height, width = photo.shape[:2]
    fine = fine_grid_of(width, height)
    residual = local_residual(pooled(static.rgb, fine), pooled(photo, fine), grid_of(width, height))
    unexplained = model.distractors.sweep.unexplained(index)
    regions = decide(comparison, lambda: unexplained, model.distractors.thresholds)
    left = torch.zeros_like(residual) if unexplained is None else unexplained.nan_to_num()
    shown = {key: value.cpu().numpy() for key, value in outputs.items()}
    return [
        photo.cpu().numpy(),
        shown["rgb_static"],
        *(_enlarged(cells, width, height) for cells in (residual, comparison.excess.values, left)),
        _enlarged(regions.float() * WHITE, width, height),
        over_checkerboard(shown["rgb_distractor"], shown["alpha_distractor"]),
        shown["distractor_mask"],
    ]


def _enlarged(cells: Float[Tensor, "rows columns"], width: int, height: int) -> Shown:
    """Cells as grey, as large as the photo."""
    grey = np.asarray(to_rgb8((cells / WHITE).clamp(0, 1)[..., None].cpu().numpy()))
    return np.asarray(Image.fromarray(grey).resize((width, height), Image.Resampling.NEAREST))


def main() -> None:
    """Entry point."""
    parser = parser_of("python -m lab.separation.stages", __doc__)
    parser.add_argument("config", type=Path)
    parser.add_argument("--view", type=int, default=12, help="training view (%(default)s)")
    parser.add_argument("--output", type=Path, default=DOCS / "explain" / "stages.jpg")
    chosen = parser.parse_args()
    pipeline: Any = load_run(find_run(chosen.config)).pipeline
    manager, device = pipeline.datamanager, pipeline.device
    camera = manager.train_dataset.cameras[chosen.view : chosen.view + 1].to(device)
    photo = torch.from_numpy(photo_of(manager.train_dataset, chosen.view)).to(device)
    with torch.no_grad():
        pictures = stages(pipeline.model, camera, photo)
    named = [(manager.train_image_names[chosen.view], pictures)]
    Image.fromarray(np.asarray(to_rgb8(sheet(named, TITLES)))).save(chosen.output, quality=88)
    print(chosen.output)


if __name__ == "__main__":
    main()
