"""The pipeline around a model whose every answer is known: what it reports, what it refuses."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from PIL import Image
from torch import nn

from desplat_ns.effects import Effects
from desplat_ns.errors import CaptureError, CheckpointError, DeSplatError
from desplat_ns.evaluation.metrics import LazyLpips, image_metrics
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.pipeline import DeSplatPipeline, DeSplatPipelineConfig
from desplat_ns.viewer import LayerControl

HEIGHT, WIDTH = 16, 20


class _NoLpips(LazyLpips):
    def __init__(self) -> None:
        super().__init__()
        self.reason = "no weights in this test"


class _Distractors(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.means = nn.Parameter(torch.zeros(5, 3))

    def counts(self) -> list[int]:
        return [2, 3]


class _Model(nn.Module):
    """Renders a plain picture: grey 0.5 and, if an open viewer asks for distractors, white."""

    def __init__(self, effects: Effects, points: int = 4) -> None:
        super().__init__()
        self.config, self.effects = SimpleNamespace(sh_degree=3), effects
        self.gauss_params = nn.ParameterDict({"means": torch.zeros(points, 3)})
        self.distractors = _Distractors() if effects.distractors else None
        self.layer_control = LayerControl(2 if effects.distractors else 0)
        self.shown_light = ShownLight([])
        self.rasterizer = SimpleNamespace(name="torch")
        self.lpips = _NoLpips()
        self.device = torch.device("cpu")
        self.step, self.renders, self.value = 0, 0, 0.5
        self.covered = 0  # columns, from the left, that distractors cover

    @property
    def num_points(self) -> int:
        return len(self.gauss_params["means"])

    def get_outputs_for_camera(self, camera: Cameras) -> dict[str, torch.Tensor]:
        self.renders += 1
        grey = 1.0 if self.layer_control.train_idx() is not None else self.value
        alpha = torch.zeros(HEIGHT, WIDTH, 1)
        alpha[:, : self.covered] = 0.75
        rgb = torch.full((HEIGHT, WIDTH, 3), grey)
        return {"rgb": rgb, "alpha_distractor": alpha, "distractor_mask": alpha > 0.5}

    forward = get_outputs_for_camera

    def get_image_metrics_and_images(self, outputs: dict, batch: dict) -> tuple[dict, dict]:
        figures = image_metrics(outputs["rgb"], batch["image"], self.lpips)
        return figures, {"img": torch.cat([batch["image"], outputs["rgb"]], dim=1)}

    def get_gt_img(self, image: torch.Tensor) -> torch.Tensor:
        return image

    def composite_with_background(
        self, image: torch.Tensor, background: torch.Tensor
    ) -> torch.Tensor:
        return image

    def get_metrics_dict(self, outputs: dict, batch: dict) -> dict:
        return {"psnr": image_metrics(outputs["rgb"], batch["image"])["psnr"]}

    def get_loss_dict(self, outputs: dict, batch: dict, metrics: dict) -> dict:
        return {}

    def update_to_step(self, step: int) -> None:
        self.step = step


def _cameras(n: int) -> Cameras:
    return Cameras(
        camera_to_worlds=torch.eye(4)[None, :3].repeat(n, 1, 1),
        fx=20.0,
        fy=20.0,
        cx=WIDTH / 2,
        cy=HEIGHT / 2,
        width=WIDTH,
        height=HEIGHT,
        metadata={"train_idx": torch.arange(n)[:, None]},
    )


@dataclass
class _Manager:
    """Evaluation photos that are 0.1, 0.2, ... brighter than what the model renders."""

    num_eval: int = 2
    train_image_names: list[str] = field(default_factory=lambda: ["a.png", "b.png"])
    masks: list[Path | None] = field(default_factory=list)
    device: str = "cpu"

    def true_masks(self) -> list[tuple[Cameras, Path]]:
        cameras = _cameras(len(self.masks))
        return [(cameras[i : i + 1], p) for i, p in enumerate(self.masks) if p is not None]

    @property
    def fixed_indices_eval_dataloader(self) -> list[tuple[Cameras, dict]]:
        cameras = _cameras(self.num_eval)
        return [(cameras[i : i + 1], self._batch(i)) for i in range(self.num_eval)]

    def _batch(self, index: int) -> dict:
        photo = torch.full((HEIGHT, WIDTH, 3), 0.5 + 0.1 * (index + 1))
        return {"image": photo, "image_idx": index}

    def next_eval_image(self, step: int) -> tuple[Cameras, dict]:
        return self.fixed_indices_eval_dataloader[0]

    next_eval = next_eval_image

    @property
    def eval_dataset(self) -> SimpleNamespace:
        names = [Path(f"/capture/images/extra_{i}.png") for i in range(self.num_eval)]
        return SimpleNamespace(image_filenames=names)

    @property
    def train_dataset(self) -> SimpleNamespace:
        return SimpleNamespace(cameras=_cameras(len(self.train_image_names)))

    @property
    def train_dataparser_outputs(self) -> SimpleNamespace:
        return SimpleNamespace(metadata={"distractor_mask_filenames": self.masks})


def _pipeline(
    manager: _Manager | None = None, distractors: bool = True, points: int = 4
) -> DeSplatPipeline:
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    parts: Any = pipeline
    parts.config = DeSplatPipelineConfig()
    parts.datamanager = manager or _Manager()
    parts._model = _Model(Effects(distractors=distractors), points)
    return pipeline


def _model(pipeline: DeSplatPipeline) -> Any:
    return pipeline.model


# --- evaluation ---------------------------------------------------------------------------------


def test_ns_evals_json_holds_every_figure_and_no_nan():
    results = _pipeline().get_average_eval_image_metrics(get_std=True)
    json.dumps(results, allow_nan=False)
    assert results["psnr"] == pytest.approx((20 - 10 * math.log10(0.04)) / 2, abs=1e-4)
    assert results["psnr_std"] == pytest.approx((20 + 10 * math.log10(0.04)) / 2**0.5, abs=1e-4)
    assert results["protocol"] == "full image, static Gaussians only"
    assert results["backend"] == "torch"
    assert results["num_images"] == 2
    assert results["num_static_gaussians"] == 4
    assert results["num_distractor_gaussians"] == 5
    assert results["static_memory_mb"] == pytest.approx(4 * 3 * 4e-6)
    assert results["distractor_memory_mb"] == pytest.approx(5 * 3 * 4e-6)
    assert 0 < results["seconds_per_image_render"] < results["seconds_per_image_with_metrics"]
    assert "lpips" not in results
    assert results["lpips_reason"] == "no weights in this test"
    assert [image["name"] for image in results["images"]] == ["extra_0.png", "extra_1.png"]
    assert results["images"][0] == {
        "name": "extra_0.png",
        "width": WIDTH,
        "height": HEIGHT,
        "psnr": pytest.approx(20.0, abs=1e-4),
        "ssim": results["images"][0]["ssim"],
    }


def test_one_evaluation_image_gives_no_standard_deviation():
    results = _pipeline(_Manager(num_eval=1)).get_average_eval_image_metrics(get_std=True)
    json.dumps(results, allow_nan=False)
    assert not [key for key in results if key.endswith("_std")]


def test_during_training_every_value_is_a_number():
    results = _pipeline().get_average_eval_image_metrics(step=100)
    assert all(isinstance(value, (int, float)) for value in results.values())
    assert {"psnr", "ssim", "num_static_gaussians"} <= results.keys()


def test_the_first_rendering_is_not_timed():
    pipeline = _pipeline()
    pipeline.get_average_eval_image_metrics(get_std=True)
    assert _model(pipeline).renders == 1 + 2


def test_pictures_are_saved_beside_their_photos(tmp_path: Path):
    folder = tmp_path / "new" / "pictures"
    _pipeline().get_average_eval_image_metrics(output_path=folder, get_std=True)
    assert sorted(p.name for p in folder.iterdir()) == ["eval_img_0000.png", "eval_img_0001.png"]
    with Image.open(folder / "eval_img_0000.png") as picture:
        assert picture.size == (2 * WIDTH, HEIGHT)
        assert picture.getpixel((0, 0)) == (153, 153, 153)  # 0.6 * 255
        assert picture.getpixel((WIDTH, 0)) == (128, 128, 128)


def _mask(path: Path, columns: int) -> Path:
    """Something in the way over so many columns, from the left."""
    picture = Image.new("L", (WIDTH, HEIGHT), 0)
    picture.paste(255, (0, 0, columns, HEIGHT))
    picture.save(path)
    return path


def test_masks_are_scored_by_ns_eval_and_only_by_it(tmp_path: Path):
    """Distractors cover 10 of 20 columns; masks cover 5, 15 and none of them."""
    wide, narrow = _mask(tmp_path / "a.png", 15), _mask(tmp_path / "b.png", 5)
    empty = _mask(tmp_path / "c.png", 0)
    names = ["a.png", "b.png", "c.png", "d.png"]
    pipeline = _pipeline(_Manager(train_image_names=names, masks=[wide, narrow, empty, None]))
    _model(pipeline).covered = 10
    results = pipeline.get_average_eval_image_metrics(get_std=True)
    assert results["num_masks"] == 3
    assert results["mask_iou"] == pytest.approx((10 / 15 + 5 / 10 + 0) / 3)
    outside = (0.0 + 0.75 * 5 / 15 + 0.75 * 10 / 20) / 3
    assert results["alpha_outside_masks"] == pytest.approx(outside)
    assert "mask_iou" not in pipeline.get_average_eval_image_metrics()


def test_without_distractors_masks_are_not_scored(tmp_path: Path):
    pipeline = _pipeline(_Manager(masks=[tmp_path / "absent.png"]), distractors=False)
    results = pipeline.get_average_eval_image_metrics(get_std=True)
    assert "mask_iou" not in results
    assert results["num_distractor_gaussians"] == 0


def test_a_split_without_evaluation_images_says_what_to_do():
    with pytest.raises(CaptureError, match="no evaluation images"):
        _pipeline(_Manager(num_eval=0)).get_average_eval_image_metrics(get_std=True)


def test_a_diverged_checkpoint_is_reported_by_ns_eval_and_survived_in_training():
    pipeline = _pipeline()
    _model(pipeline).value = math.nan
    with pytest.raises(DeSplatError, match=r"2 of 2 images.*extra_0\.png"):
        pipeline.get_average_eval_image_metrics(get_std=True)
    results = pipeline.get_average_eval_image_metrics()
    assert "psnr" not in results
    assert all(math.isfinite(value) for value in results.values())


def test_an_open_viewer_never_puts_distractors_into_an_evaluation():
    pipeline = _pipeline()
    plain = pipeline.get_average_eval_image_metrics()["psnr"]
    _model(pipeline).layer_control.layer.value = "composite"
    assert pipeline.get_average_eval_image_metrics()["psnr"] == plain
    assert pipeline.get_eval_image_metrics_and_images(0)[0]["psnr"] == pytest.approx(20, abs=1e-4)
    assert pipeline.get_eval_loss_dict(0)[2]["psnr"] == pytest.approx(20, abs=1e-4)
    assert _model(pipeline).layer_control.train_idx() == 0


def test_training_goes_on_in_training_mode():
    pipeline = _pipeline()
    pipeline.get_average_eval_image_metrics()
    assert pipeline.training
    assert pipeline.model.training


# --- checkpoints --------------------------------------------------------------------------------


def _saved(**changes: Any) -> dict[str, Any]:
    """A checkpoint's pipeline state, whose static Gaussians all lie at 1."""
    pipeline = _pipeline(**changes)
    _model(pipeline).gauss_params["means"].data.fill_(1.0)
    return pipeline.state_dict()


def _is_untouched(pipeline: DeSplatPipeline) -> bool:
    return _model(pipeline).step == 0 and not _model(pipeline).gauss_params["means"].any()


def test_a_checkpoint_of_the_same_scene_is_loaded_with_its_step():
    pipeline = _pipeline()
    pipeline.load_pipeline(_saved(), 7)
    assert (_model(pipeline).gauss_params["means"] == 1).all()
    assert _model(pipeline).step == 7


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"manager": _Manager(train_image_names=["x.png"])}, "another scene"),
        ({"distractors": False}, r"--pipeline\.model\.effects\.distractors False"),
    ],
)
def test_another_scene_or_other_effects_are_refused_before_anything_changes(
    changes: dict, message: str
):
    pipeline = _pipeline()
    with pytest.raises(CheckpointError, match=message):
        pipeline.load_pipeline(_saved(**changes), 7)
    assert _is_untouched(pipeline)


def test_missing_and_unexpected_parameters_are_listed_before_anything_changes():
    pipeline, state = _pipeline(), _saved()
    state["_model.extra"] = state.pop("_model.distractors.means")
    message = r"1 missing parameters \(_model\.distractors\.means\), 1 unexpected .*_model\.extra"
    with pytest.raises(CheckpointError, match=message):
        pipeline.load_pipeline(state, 7)
    assert _is_untouched(pipeline)


def test_parameters_of_the_wrong_shape_are_named():
    with pytest.raises(CheckpointError, match=r"gauss_params\.means.*config\.yml"):
        _pipeline().load_pipeline(_saved(points=6), 7)


def test_a_checkpoint_of_another_method_is_refused():
    state = _saved()
    del state["_extra_state"]
    with pytest.raises(CheckpointError, match="not saved by `desplat`"):
        _pipeline().load_pipeline(state, 7)


def test_photos_too_small_for_the_first_steps_stop_before_training(tiny_run, tmp_path: Path):
    config = tiny_run(tmp_path)
    config.pipeline.model.num_downscales = 5
    with pytest.raises(CaptureError, match=r"photos .* 64 pixels .*1/32 .*\(48x32\)"):
        config.pipeline.setup(device="cpu")
