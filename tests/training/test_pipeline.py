"""The pipeline around a model whose every answer is known: what it reports, what it refuses, which
checkpoints it loads and what it says of the others."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from nerfstudio.cameras.cameras import Cameras
from PIL import Image
from torch import nn

from desplat_ns.core.effects import EffectsConfig
from desplat_ns.core.errors import CaptureError, CheckpointError, DeSplatError
from desplat_ns.training.pipeline import DeSplatPipeline, DeSplatPipelineConfig
from tests.helpers.small_model import HEIGHT, NUM_VIEWS, WIDTH, cameras, held_out, make_model

NAMES = ["a.png", "b.png", "c.png"]
SECONDS = ("seconds_per_image_render", "seconds_per_image_with_metrics")


@dataclass
class KnownManager:
    """The part of a datamanager that a pipeline asks for; photos are 0.1, 0.2, ... brighter."""

    num_eval: int = 2
    train_image_names: list[str] = field(default_factory=lambda: NAMES)
    masks: list[Path] = field(default_factory=list)
    """Of the first training views."""
    device: str = "cpu"
    train_dataset: Any = field(default_factory=lambda: SimpleNamespace(cameras=numbered()))
    shown: Any = None
    """What the model renders of a held-out photo."""

    def remembered(self) -> dict[str, torch.Tensor]:
        return {"camera_to_worlds": self.train_dataset.cameras.camera_to_worlds}

    def gt_masks(self) -> list[tuple[Cameras, Path]]:
        return [(numbered()[i : i + 1], path) for i, path in enumerate(self.masks)]

    @property
    def eval_dataset(self) -> SimpleNamespace:
        names = [Path(f"/capture/images/extra_{i}.png") for i in range(self.num_eval)]
        return SimpleNamespace(image_filenames=names)

    @property
    def fixed_indices_eval_dataloader(self) -> list[tuple[Cameras, dict]]:
        images = (self.shown + 0.1 * (i + 1) for i in range(self.num_eval))
        batches = ({"image": image, "image_idx": i} for i, image in enumerate(images))
        return [(held_out(), batch) for batch in batches]

    def next_eval(self, step: int) -> tuple[Cameras, dict]:
        return self.fixed_indices_eval_dataloader[0]

    next_eval_image = next_eval


def numbered() -> Cameras:
    """The training cameras with the numbers of their views."""
    numbered = cameras()
    numbered.metadata = {"train_idx": torch.arange(NUM_VIEWS)[:, None]}
    return numbered


def known_pipeline(
    manager: KnownManager | None = None, distractors: bool = True, **options: Any
) -> Any:
    """A pipeline that needs no capture.

    Args:
        options: of the model.
    """
    pipeline = DeSplatPipeline.__new__(DeSplatPipeline)
    nn.Module.__init__(pipeline)
    parts: Any = pipeline
    parts.config, parts.datamanager = DeSplatPipelineConfig(), manager or KnownManager()
    parts._model = model = make_model(effects=EffectsConfig(distractors=distractors), **options)
    parts.datamanager.shown = model.eval().get_outputs_for_camera(held_out())["rgb"]
    model.train()
    return pipeline


def test_ns_evals_json_holds_every_figure_and_no_nan():
    pipeline = known_pipeline()
    results = pipeline.get_average_eval_image_metrics(get_std=True)
    json.dumps(results, allow_nan=False)
    assert results["psnr"] == pytest.approx((20 - 10 * math.log10(0.04)) / 2, abs=1e-4)
    assert results["psnr_std"] == pytest.approx((20 + 10 * math.log10(0.04)) / 2**0.5, abs=1e-4)
    assert results["psnr_worst"] == min(image["psnr"] for image in results["images"])
    assert results["backend"] == "numba"
    assert results["num_images"] == 2
    assert results["num_static_gaussians"] == 30
    assert results["num_distractor_gaussians"] == 60
    numbers = sum(p.numel() for p in pipeline.model.gauss_params.values())
    assert results["static_memory_mb"] == pytest.approx(numbers * 4e-6)
    numbers = 20 * (3 + 3 + 4 + 1 + 3)
    assert results["distractor_memory_mb"] == pytest.approx(3 * numbers * 4e-6)
    assert 0 < results["seconds_per_image_render"] < results["seconds_per_image_with_metrics"]
    assert not {"lpips", "mask_iou"} & results.keys()
    alone = known_pipeline(KnownManager(num_eval=1)).get_average_eval_image_metrics(get_std=True)
    assert "psnr_std" not in alone
    assert [image["name"] for image in results["images"]] == ["extra_0.png", "extra_1.png"]
    assert results["images"][0] == {
        "name": "extra_0.png",
        "width": WIDTH,
        "height": HEIGHT,
        "psnr": pytest.approx(20.0, abs=1e-4),
        **{key: results["images"][0][key] for key in ("ssim", *SECONDS)},
    }


def test_pictures_are_saved_beside_their_photos(tmp_path: Path):
    folder = tmp_path / "new" / "pictures"
    known_pipeline().get_average_eval_image_metrics(output_path=folder, get_std=True)
    assert sorted(p.name for p in folder.iterdir()) == ["eval_img_0000.png", "eval_img_0001.png"]
    with Image.open(folder / "eval_img_0000.png") as picture:
        assert picture.size == (2 * WIDTH, HEIGHT)
        assert picture.getpixel((0, 0)) == (26, 26, 26)  # 0.1 * 255
        assert picture.getpixel((WIDTH, 0)) == (0, 0, 0)


def render(pipeline: Any, **outputs: torch.Tensor) -> None:
    """Have a pipeline's model render this, and else what it does."""
    draw = pipeline.model.get_outputs_for_camera
    pipeline.model.get_outputs_for_camera = lambda camera: {**draw(camera), **outputs}


def _mask(path: Path, columns: int) -> Path:
    """Something in the way over so many columns, from the left."""
    picture = Image.new("L", (WIDTH, HEIGHT), 0)
    picture.paste(255, (0, 0, columns, HEIGHT))
    picture.save(path)
    return path


def half_covered(masks: list[Path]) -> Any:
    """A pipeline whose distractors cover 12 of 24 columns of each training view."""
    pipeline, alpha = known_pipeline(KnownManager(masks=masks)), torch.zeros(HEIGHT, WIDTH, 1)
    alpha[:, :12] = 0.75
    render(pipeline, alpha_distractor=alpha, distractor_mask=alpha > 0.5)
    return pipeline


def test_masks_are_scored_by_ns_eval_and_only_by_it(tmp_path: Path):
    """Masks cover 18, 6 and none of the columns."""
    pipeline = half_covered([_mask(tmp_path / f"{columns}.png", columns) for columns in (18, 6, 0)])
    results = pipeline.get_average_eval_image_metrics(get_std=True)
    assert results["num_masks"] == 3
    assert results["mask_iou"] == pytest.approx((12 / 18 + 6 / 12 + 0) / 3)
    outside = (0.0 + 0.75 * 6 / 18 + 0.75 * 12 / 24) / 3
    assert results["alpha_outside_masks"] == pytest.approx(outside)
    assert "mask_iou" not in pipeline.get_average_eval_image_metrics()


def test_a_mask_over_everything_has_nothing_outside_and_bent_photos_have_no_scores(tmp_path: Path):
    pipeline = half_covered([_mask(tmp_path / "all.png", WIDTH)])
    results = pipeline.get_average_eval_image_metrics(get_std=True)
    assert results["mask_iou"] == pytest.approx(0.5) and "alpha_outside_masks" not in results
    ((camera, path),) = pipeline.datamanager.gt_masks()
    camera.distortion_params = torch.full((1, 6), 0.1)
    pipeline.datamanager.gt_masks = lambda: [(camera, path)]
    assert "mask_iou" not in pipeline.get_average_eval_image_metrics(get_std=True)


def test_a_split_without_evaluation_images_says_what_to_do():
    with pytest.raises(CaptureError, match="--eval-mode"):
        known_pipeline(KnownManager(num_eval=0)).get_average_eval_image_metrics(get_std=True)


def test_a_diverged_checkpoint_is_reported_by_ns_eval_and_survived_in_training():
    pipeline = known_pipeline()
    render(pipeline, rgb=torch.full((HEIGHT, WIDTH, 3), math.nan))
    with pytest.raises(DeSplatError, match=r"extra_0\.png"):
        pipeline.get_average_eval_image_metrics(get_std=True)
    results = pipeline.get_average_eval_image_metrics()
    assert "psnr" not in results
    assert all(math.isfinite(value) for value in results.values())
    assert pipeline.training and pipeline.model.training


def test_an_open_viewer_never_puts_distractors_into_an_evaluation():
    pipeline = known_pipeline()
    plain = pipeline.get_average_eval_image_metrics()["psnr"]
    pipeline.model.layer_control.layer.value = "composite"
    assert pipeline.get_average_eval_image_metrics()["psnr"] == plain
    with pipeline.static_scene():
        image = pipeline.get_eval_image_metrics_and_images(0)[0]
        assert image["psnr"] == pytest.approx(20, abs=1e-4)
        loss = pipeline.get_eval_loss_dict(0)[2]
        assert loss["psnr"].item() == pytest.approx(20, abs=1e-4)
    assert pipeline.model.layer_control.train_idx() == 0


def test_a_trained_run_whose_backend_cannot_draw_on_the_gpu_is_rendered_on_the_cpu(
    tiny_run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    """As nerfstudio's commands set it up: on CUDA, because there is a device."""
    config = tiny_run(tmp_path)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(
        "desplat_ns.backend.gsplat_build.unavailable_reason", lambda: "has no nvcc."
    )
    pipeline = config.pipeline.setup(device=torch.device("cuda"), test_mode="test")
    assert pipeline.device.type == "cpu"
    assert "has no nvcc" in " ".join(capsys.readouterr().out.split())


def saved(**changes: Any) -> dict[str, Any]:
    """A checkpoint's pipeline state, whose static Gaussians all lie at 1."""
    pipeline = known_pipeline(**changes)
    pipeline.model.gauss_params["means"].data.fill_(1.0)
    return pipeline.state_dict()


def test_a_checkpoint_of_the_same_scene_is_loaded_with_its_step():
    for names in (NAMES, []):  # of none where the run that saved it knew none
        pipeline = known_pipeline()
        pipeline.load_pipeline(saved(manager=KnownManager(train_image_names=names)), 7)
        assert (pipeline.model.gauss_params["means"] == 1).all()
        assert pipeline.model.step == 7


def photos(*names: str) -> dict[str, Any]:
    return {"manager": KnownManager(train_image_names=list(names))}


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"distractors": False}, r"--pipeline\.model\.effects\.distractors False"),
        ({"sh_degree": 2}, r"--pipeline\.model\.sh-degree 2"),
        (photos("a.png", "x.png", "y.png"), "'b.png'"),
        (photos("a.png", "b.png"), "'c.png'"),
        (photos("b.png", "a.png", "c.png"), "order"),
    ],
)
def test_a_checkpoint_of_another_scene_or_of_other_settings_changes_nothing_and_is_refused(
    changes: dict, named: str
):
    pipeline = known_pipeline()
    with pytest.raises(CheckpointError, match=named):
        pipeline.load_pipeline(saved(**changes), 7)
    assert pipeline.model.step == 0 and not (pipeline.model.means == 1).any()


def moved(by: float) -> KnownManager:
    """The second training camera stands elsewhere."""
    views = numbered()
    views.camera_to_worlds = views.camera_to_worlds.clone()
    views.camera_to_worlds[1, 0, 3] += by
    return KnownManager(train_dataset=SimpleNamespace(cameras=views))


def test_a_capture_whose_poses_are_others_is_refused_unless_by_rounding_or_none_are_remembered():
    pipeline = known_pipeline(moved(0.1))
    with pytest.raises(CheckpointError, match=r"1 of 3 photos.*b\.png.*train anew"):
        pipeline.load_pipeline(saved(), 7)
    assert pipeline.model.step == 0
    known_pipeline(moved(1e-6)).load_pipeline(saved(), 7)
    state = saved()
    del state["_extra_state"]["cameras"]
    pipeline.load_pipeline(state, 7)
    assert pipeline.model.step == 7


MEANS = "_model.gauss_params.means"


@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda state: state.pop("_extra_state"), "desplat"),  # as another method saves it
        (lambda state: state["_extra_state"].pop("sh_degree"), "version"),
        (lambda state: state.update({"_model.x": state.pop(MEANS)}), '(?s)means.*"x"'),
    ],
)
def test_a_checkpoint_whose_parameters_do_not_fit_is_refused(
    spoil: Callable[[dict], None], named: str
):
    pipeline, state = known_pipeline(), saved()
    spoil(state)
    with pytest.raises(CheckpointError, match=named):
        pipeline.load_pipeline(state, 7)
    assert pipeline.model.step == 0
