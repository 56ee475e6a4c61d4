"""Files of a run on real photos, read back by others and drawn by the capture's own cameras."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pycolmap
import pytest
import torch

from desplat_ns.backend.protocol import View
from tests.helpers.clouds import drawn
from tests.helpers.page_beside_photos import LEAST_PSNR as LEAST_PAGE
from tests.helpers.page_beside_photos import MOST_BELOW, page_beside_photos, short_run
from tests.helpers.splat_readers import read_splats

pytestmark = [pytest.mark.slow, pytest.mark.real_data]

STEPS, DOWNSCALE = 300, 4
LEAST_PSNR = {".ply": 80.0, ".spz": 40.0}
"""dB. A PLY has float32, as the model does: errors of 1e-6 make 120 dB, and single Gaussians may
cross a cutoff of 1/255. An SPZ rounds colours to steps of 1/136 and opacities to steps of 1/255:
0.01 make 40 dB."""


@pytest.fixture(scope="module")
def capture(data_folder: Callable[[str], Path]) -> Path:
    return data_folder("fox_cluttered")


@pytest.fixture(scope="module")
def run(capture: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """config.yml of a short run, with distractors."""
    return short_run(capture, DOWNSCALE, STEPS, tmp_path_factory.mktemp("runs"))


@pytest.mark.parametrize("ending", list(LEAST_PSNR))
def test_a_file_in_the_captures_frame_shows_the_scene_to_the_captures_cameras(
    run: Path, capture: Path, tmp_path: Path, ending: str
):
    from nerfstudio.utils.eval_utils import eval_setup

    from desplat_ns.commands.export import Splats
    from desplat_ns.viewer import LayerControl

    Splats(run, tmp_path / f"a{ending}", "capture").main()
    cloud = read_splats((tmp_path / f"a{ending}").read_bytes(), ending[1:])
    pipeline: Any = eval_setup(run)[1]
    pipeline.model.layer_control = LayerControl(0)  # without a near plane, as other viewers
    photos = pipeline.datamanager.eval_dataset
    camera, _ = pipeline.datamanager.fixed_indices_eval_dataloader[0]
    with torch.no_grad():
        outputs = pipeline.model.get_outputs_for_camera(camera)
    behind = (1 - outputs["accumulation"]) * outputs["background"]  # not in any file
    shown = (outputs["rgb"] - behind).numpy()
    name = Path(photos.image_filenames[0]).name
    picture = drawn(cloud, view_by_colmap(capture / "sparse" / "0", name)).clip(0, 1)
    assert psnr(picture, shown) > LEAST_PSNR[ending]
    photo = photos.get_numpy_image(0)[..., :3] / 255
    assert psnr(picture, photo) > 25, "it is the scene that the photo shows"


def test_masks_cover_what_was_pasted_into_the_photos(run: Path, capture: Path, tmp_path: Path):
    from desplat_ns.commands.export import Masks

    Masks(run, tmp_path / "masks", invert=True, names="nerfstudio").main()
    both = either = 0
    written = sorted((tmp_path / "masks").iterdir())
    assert len(written) == len(list((capture / "images").glob("clutter_*")))
    for path in written:
        truth, mask = (
            np.asarray(PIL.Image.open(folder / path.name)) > 127
            for folder in (capture / "masks", path.parent)
        )
        assert mask.shape == truth.shape, "of the photo's full size"
        both, either = both + (mask & truth).sum(), either + (mask | truth).sum()
    assert both / either > 0.7


def test_a_page_shows_what_we_render_to_training_and_held_out_cameras(run: Path, tmp_path: Path):
    from desplat_ns.runs.files import find_run
    from desplat_ns.runs.loading import load_run

    compared = page_beside_photos(load_run(find_run(run)), tmp_path)
    assert compared.of_ours.min() > LEAST_PAGE, compared
    assert compared.below_ours.max() < MOST_BELOW, compared


def view_by_colmap(model: Path, name: str) -> View:
    """A photo's camera as pycolmap reads it, at 1 / `DOWNSCALE` of its size."""
    read = pycolmap.Reconstruction(model)
    (image,) = (image for image in read.images.values() if image.name == name)
    camera = read.cameras[image.camera_id]
    pose = np.vstack([image.cam_from_world().matrix(), [0, 0, 0, 1]])
    width, height = camera.width // DOWNSCALE, camera.height // DOWNSCALE
    scale = np.array([[width / camera.width], [height / camera.height], [1]])
    intrinsics = camera.calibration_matrix() * scale
    return View(torch.from_numpy(pose), torch.from_numpy(intrinsics), width, height)


def psnr(image: np.ndarray, other: np.ndarray) -> float:
    return float(-10 * np.log10(np.mean((image - other) ** 2)))
