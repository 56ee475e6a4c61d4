"""Files of a run lie where the capture's own cameras look; a crop keeps what is near to them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest
import torch

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.export.export import export_splats, within
from desplat_ns.runs.files import find_run
from desplat_ns.runs.loading import load_run
from desplat_ns.viewer import LayerControl
from tests.helpers.scene import psnr
from tests.helpers.splat_files import drawn, read_splats, view


def rendering(camera: View, depth: float, alpha: float) -> Rendering:
    size = (camera.height, camera.width, 1)
    depths = torch.full(size, depth)
    depths[0] = 1e6  # a row of sky
    return Rendering(
        torch.zeros(camera.height, camera.width, 3),
        torch.full(size, alpha),
        depths,
        torch.zeros(1, 0, 2),
        torch.zeros(0, dtype=torch.int64),
    )


def test_points_are_kept_up_to_a_multiple_of_the_median_depth_that_a_camera_shows():
    pose = np.eye(4)
    pose[0, 3] = -10  # at (10, 0, 0)
    depths = iter([1.0, 2.0])
    points = np.array([[1.9, 0, 0], [2.1, 0, 0], [6.1, 0, 0], [14.1, 0, 0]])
    kept = within(points, [view(), view(pose)], lambda c: rendering(c, next(depths), 0.9), 2.0)
    assert kept.tolist() == [True, False, True, False]


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "least"), [("ply", 80.0), ("spz", 40.0)])
def test_a_file_in_the_captures_frame_shows_the_scene_to_the_captures_cameras(
    trained: Path, tiny_scene: Any, tmp_path: Path, ending: str, least: float
):
    """A PLY has float32, as the model does: errors of 1e-6 make 120 dB, and single Gaussians may
    cross a cutoff of 1/255. An SPZ rounds colours to steps of 1/136 and opacities to steps of
    1/255: 0.01 make 40 dB."""
    export_splats(find_run(trained), tmp_path / f"a.{ending}", "capture", None, None)
    cloud = read_splats((tmp_path / f"a.{ending}").read_bytes(), ending)
    pipeline: Any = load_run(find_run(trained)).pipeline
    pipeline.model.layer_control = LayerControl([])  # without a near plane, as other viewers
    camera, _ = pipeline.datamanager.fixed_indices_eval_dataloader[0]
    with torch.no_grad():
        outputs = pipeline.model.get_outputs_for_camera(camera)
    behind = (1 - outputs["accumulation"]) * outputs["background"]  # not in any file
    read = pycolmap.Reconstruction(tiny_scene.folder / "sparse" / "0")
    name = Path(pipeline.datamanager.eval_dataset.image_filenames[0]).name
    (image,) = (image for image in read.images.values() if image.name == name)
    pose = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
    own = read.cameras[image.camera_id]
    K = torch.from_numpy(own.calibration_matrix())
    picture = drawn(cloud, View(torch.from_numpy(pose), K, own.width, own.height)).clip(0, 1)
    assert psnr(picture, (outputs["rgb"] - behind).numpy()) > least
