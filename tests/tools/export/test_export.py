"""Files of a run lie where the capture's own cameras look; a crop keeps what is near to them."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
import torch
from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
from scipy.spatial.transform import Rotation

from desplat_ns.backend.protocol import Rendering, View
from desplat_ns.core.run_files import RunFiles, find_run
from desplat_ns.data.transforms_json import TransformsDataParser
from desplat_ns.tools.commands.export import Splats
from desplat_ns.tools.export import export
from desplat_ns.tools.export.export import export_splats, reach_of
from desplat_ns.tools.export.splat_cloud import OFF_BY
from desplat_ns.tools.loading import load_run
from desplat_ns.training.datamanager import DeSplatDataManager
from desplat_ns.viewer import LayerControl
from tests.helpers.files import write_transforms
from tests.helpers.scene import psnr
from tests.helpers.splat_files import cloud, drawn, read_splats, view


def rendering(camera: View, depth: float, alpha: float) -> Rendering:
    size = (camera.height, camera.width, 1)
    depths = torch.full(size, depth)
    depths[0] = 1e6  # a row of sky
    nothing = torch.zeros(1, 0, 2), torch.zeros(0, dtype=torch.int64)
    black = torch.zeros(camera.height, camera.width, 3)
    return Rendering(black, torch.full(size, alpha), depths, *nothing)


def test_a_camera_looks_as_far_as_the_median_depth_of_what_is_opaque():
    assert reach_of(view(), lambda small: rendering(small, 2.0, 0.9)) == 2.0
    assert reach_of(view(), lambda small: rendering(small, 2.0, 0.4)) is None


@pytest.mark.parametrize(("ending", "least"), [("ply", 80.0), ("spz", 40.0)])
def test_a_file_in_the_captures_frame_shows_the_scene_to_the_captures_cameras(
    trained: Path, tiny_scene: Any, tmp_path: Path, ending: str, least: float
):
    """A PLY has float32, as the model does: errors of 1e-6 make 120 dB, and single Gaussians may
    cross a cutoff of 1/255. An SPZ rounds colours to steps of 1/136 and opacities to steps of
    1/255: 0.01 make 40 dB."""
    output = tmp_path / f"a.{ending}"
    export_splats(find_run(trained), Splats(output=output, frame="capture"))
    cloud = read_splats(output.read_bytes(), ending)
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


UTM = np.array([465000.5, 5250000, 400])


@pytest.mark.parametrize("ending", ["ply", "spz"])
def test_a_nerfstudio_captures_frame_is_that_of_its_own_points_also_far_out(
    tmp_path: Path, photo_writer: Any, monkeypatch: pytest.MonkeyPatch, capsys: Any, ending: str
):
    """Gaussians at the points of a PLY in UTM go back there, whatever `applied_transform` says of
    the world before; float32 has steps of half a unit there, and the Gaussians have 0.05."""
    points = np.random.default_rng(0).uniform(-3, 3, (200, 3)) + UTM
    rows = "".join("{:.6f} {:.6f} {:.6f}\n".format(*point) for point in points)
    properties = "".join(f"property double {axis}\n" for axis in "xyz")
    head = f"ply\nformat ascii 1.0\nelement vertex 200\n{properties}end_header\n"
    (tmp_path / "sparse_pc.ply").write_text(head + rows)
    frames = []
    for i in range(4):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("z", 0.7 * i).as_matrix()
        pose[:3, 3] = UTM + np.array([i, i % 2, 0])
        photo_writer(tmp_path / "images" / f"{i}.png", seed=i)
        frames.append({"file_path": f"images/{i}.png", "transform_matrix": pose.tolist()})
    applied = [[1, 0, 0, 0], [0, 0, 1, 5], [0, -1, 0, 0]]
    files = {"ply_file_path": "sparse_pc.ply", "applied_transform": applied}
    write_transforms(tmp_path, [], frames=frames, **files)
    config = NerfstudioDataParserConfig(data=tmp_path, load_3D_points=True)
    parser = TransformsDataParser(config)
    outputs = parser.get_dataparser_outputs("train")
    assert torch.allclose(outputs.dataparser_transform, parser.oriented.transform.float())
    dataset = SimpleNamespace(cameras=outputs.cameras)
    manager: Any = SimpleNamespace(
        dataparser=parser, train_dataparser_outputs=outputs, train_dataset=dataset
    )
    manager.remembered = partial(DeSplatDataManager.remembered, manager)
    model = SimpleNamespace(effects=SimpleNamespace(background="off"))
    run = SimpleNamespace(pipeline=SimpleNamespace(datamanager=manager, model=model))
    trained = replace(
        cloud(count=200),
        means=outputs.metadata["points3D_xyz"].double().numpy(),
        scales=np.full((200, 3), 0.05 * outputs.dataparser_scale, np.float32),
    )
    monkeypatch.setattr(export, "load_run", lambda files, needs_photos: run)
    monkeypatch.setattr(export, "static_cloud", lambda *options: (trained, None))
    output = tmp_path / f"a.{ending}"
    export_splats(RunFiles(tmp_path, tmp_path), Splats(output=output, frame="capture"))
    offset = np.array((tmp_path / f"a.{ending}.offset.txt").read_text().split(), float)
    content = output.read_bytes()
    means = read_splats(content, ending).means
    if ending == "ply":
        assert "comment offset {} {} {}\n".format(*offset).encode() in content
    assert np.abs(means + offset - points).max() <= OFF_BY * 0.05
    assert (offset == np.round(offset)).all()
    assert f"a.{ending}.offset.txt" in capsys.readouterr().out
