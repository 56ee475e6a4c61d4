"""Training pipeline: evaluation that says what it measured, checkpoints that fit or say why not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import torch
from nerfstudio.cameras.cameras import Cameras
from nerfstudio.pipelines.base_pipeline import VanillaPipeline, VanillaPipelineConfig
from nerfstudio.viewer.viewer_elements import ViewerDropdown, ViewerSlider
from torchvision.utils import save_image

from desplat_ns.console import progress_over
from desplat_ns.data.training_views import image_names
from desplat_ns.errors import CaptureError, CheckpointError, DeSplatError
from desplat_ns.evaluation.config import EvaluationConfig, uses_halves
from desplat_ns.evaluation.mask_scores import score_masks
from desplat_ns.evaluation.metrics import LPIPS_NET
from desplat_ns.evaluation.records import (
    ScoredImage,
    gaussian_counts,
    per_image,
    summarize,
    versions,
)
from desplat_ns.evaluation.stopwatch import Stopwatch
from desplat_ns.nerfstudio_quirks import (
    give_masks_a_colormap_in_the_viewer,
    load_evaluated_checkpoints_like_resumed_ones,
)
from desplat_ns.photo_tourism.embedding_file import digest_of, load_embeddings, save_embeddings
from desplat_ns.photo_tourism.halves import HalvesProtocol
from desplat_ns.training.checkpoint_record import SceneRecord, check_same_scene

PROTOCOL = "full image, static Gaussians only"
"""How evaluation images are scored; the JSON names it beside every figure."""

MAX_KEYS_LISTED = 5
"""Parameters that an error message names before it only counts."""


@dataclass
class DeSplatPipelineConfig(VanillaPipelineConfig):
    """Configuration of the pipeline."""

    _target: type = field(default_factory=lambda: DeSplatPipeline)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    """How `ns-eval` scores images."""


class DeSplatPipeline(VanillaPipeline):
    """nerfstudio's pipeline with its own evaluation and strict loading."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        manager, model = cast(Any, self.datamanager), cast(Any, self.model)
        manager.train_dataset.check_sides(model.config.num_downscales)
        manager.eval_dataset.check_sides(0)
        give_masks_a_colormap_in_the_viewer()
        load_evaluated_checkpoints_like_resumed_ones()

    # --- viewer ------------------------------------------------------------------------------

    @property
    def layer(self) -> ViewerDropdown | None:
        """The viewer's choice of layer; None where there are no distractors."""
        control = cast(Any, self.model).layer_control
        return control.layer if control.num_views > 0 else None

    @property
    def training_view(self) -> ViewerSlider | None:
        """The viewer's choice of whose distractors to show; None where there are none."""
        control = cast(Any, self.model).layer_control
        return control.view if control.num_views > 0 else None

    @property
    def appearance(self) -> ViewerDropdown | None:
        """The viewer's choice of whose light is shown; None where there is no appearance model."""
        worn = cast(Any, self.model).worn
        return worn.first if worn.names else None

    @property
    def appearance_mixed(self) -> ViewerDropdown | None:
        """The viewer's choice of a second image to mix in; None as above."""
        worn = cast(Any, self.model).worn
        return worn.second if worn.names else None

    @property
    def appearance_share(self) -> ViewerSlider | None:
        """The viewer's share of the second image; None as above."""
        worn = cast(Any, self.model).worn
        return worn.share if worn.names else None

    @contextmanager
    def _static_scene(self) -> Iterator[None]:
        model = cast(Any, self.model)
        with model.layer_control.suspended(), model.worn.suspended():
            yield

    # --- evaluation --------------------------------------------------------------------------

    def get_eval_loss_dict(self, step: int) -> Any:
        """Upstream's, of the static scene whatever an open viewer shows."""
        with self._static_scene():
            return super().get_eval_loss_dict(step)

    def get_eval_image_metrics_and_images(self, step: int) -> Any:
        """Upstream's, of the static scene whatever an open viewer shows."""
        with self._static_scene():
            return super().get_eval_image_metrics_and_images(step)

    def get_average_image_metrics(
        self,
        data_loader: Any,
        image_prefix: str,
        step: int | None = None,
        output_path: Path | None = None,
        get_std: bool = False,
    ) -> dict[str, Any]:
        """Means over the images, sizes and times; what `ns-eval` writes and TensorBoard plots.

        `get_std` is how nerfstudio 1.1.5 marks a call by `ns-eval`: only then are there standard
        deviations (of two images or more), texts, per-image figures and mask scores, and only then
        does the protocol of `evaluation` hold; in training every value is a number, as its event
        writers need, and images are scored whole in the average light. `output_path`: a folder for
        the photo and the rendering of every image, side by side.

        Raises:
            CaptureError: there is no image to evaluate.
            CheckpointError: embeddings to load that are not there or not this model's.
            ConfigError: the protocol does not fit the model.
            DeSplatError: called by `ns-eval`, and a figure of an image is not a finite number.
        """
        self.eval()
        with self._static_scene():
            halves = self._halves_protocol() if get_std else None
            images = self._score_images(
                data_loader, image_prefix, output_path, halves, warm_up=get_std
            )
            results: dict[str, Any] = {**summarize(images, get_std)}
            results |= gaussian_counts(self.model)
            if get_std:
                _check_finite(images)
                results |= self._mask_scores()
                results |= self._texts()
                results["protocol"] = PROTOCOL if halves is None else halves.describe()
                results["images"] = per_image(images)
            self._save_embeddings(halves)
        self.train()
        return results

    def _halves_protocol(self) -> HalvesProtocol | None:
        config, model = cast(Any, self.config).evaluation, cast(Any, self.model)
        if not uses_halves(config, model.config.effects.appearance):
            return None
        known = {}
        if config.load_embeddings is not None:
            digest = digest_of(model.image_effects)
            known = load_embeddings(config.load_embeddings, digest, model.device)
        return HalvesProtocol(config, known)

    def _save_embeddings(self, halves: HalvesProtocol | None) -> None:
        path = cast(Any, self.config).evaluation.save_embeddings
        if halves is not None and path is not None:
            digest = digest_of(cast(Any, self.model).image_effects)
            save_embeddings(path, halves.embeddings, digest)

    def _score_images(
        self,
        data_loader: Any,
        prefix: str,
        output_path: Path | None,
        halves: HalvesProtocol | None,
        warm_up: bool,
    ) -> list[ScoredImage]:
        loader = list(data_loader)
        if not loader:
            raise CaptureError(
                "The capture has no evaluation images, so there is nothing to score. Choose a "
                "split that has some, with the data parser's `--eval-mode` or its split options."
            )
        if warm_up:  # compilation and caches are no part of the time per image
            self.model.get_outputs_for_camera(loader[0][0])
        dataset = self._dataset(prefix)
        names = image_names([Path(name) for name in dataset.image_filenames])
        images: list[ScoredImage] = []
        with progress_over(len(loader), "Evaluating all images...") as advance:
            for index, (camera, batch) in enumerate(loader):
                name = names[int(batch.get("image_idx", index))]
                if halves is None:
                    scored, pictures = self._score_image(camera, batch, name)
                else:
                    scored, pictures = halves.score(self.model, camera, batch, name)
                images.append(scored)
                _save(pictures, output_path, f"{prefix}_{{}}_{index:04d}.png")
                advance()
        return images

    def _dataset(self, prefix: str) -> Any:
        manager = cast(Any, self.datamanager)
        return manager.eval_dataset if prefix == "eval" else manager.train_dataset

    def _score_image(
        self, camera: Cameras, batch: dict[str, Any], name: str
    ) -> tuple[ScoredImage, dict[str, torch.Tensor]]:
        watch = Stopwatch(torch.device(self.device))
        watch.start()
        outputs = self.model.get_outputs_for_camera(camera)
        render_seconds = watch.seconds()
        metrics, pictures = self.model.get_image_metrics_and_images(outputs, batch)
        height, width = outputs["rgb"].shape[:2]
        scored = ScoredImage(name, width, height, metrics, render_seconds, watch.seconds())
        return scored, pictures

    def _mask_scores(self) -> dict[str, int | float]:
        if cast(Any, self.model).distractors is None:
            return {}
        return score_masks(self.model, self.datamanager)

    def _texts(self) -> dict[str, Any]:
        model = cast(Any, self.model)
        texts: dict[str, Any] = {
            "backend": model.rasterizer.name,
            "device": str(self.device),
            "versions": versions(),
        }
        reason = getattr(model.lpips, "reason", None)
        return texts | ({"lpips_net": LPIPS_NET} if reason is None else {"lpips_reason": reason})

    # --- checkpoints -------------------------------------------------------------------------

    def scene_record(self) -> SceneRecord:
        """What a checkpoint of this pipeline belongs to."""
        config = cast(Any, self.model).config
        names = getattr(self.datamanager, "train_image_names", [])
        return SceneRecord(asdict(config.effects), config.sh_degree, list(names))

    def get_extra_state(self) -> dict[str, Any]:
        """The scene record, for the checkpoint."""
        return self.scene_record().to_state()

    def set_extra_state(self, state: object) -> None:
        """Nothing is taken over from the record: it is compared before loading."""

    def load_pipeline(self, loaded_state: dict[str, Any], step: int) -> None:
        """Load a checkpoint's pipeline as it stood after `step`.

        Raises:
            CheckpointError: it belongs to another scene or other effects, or lacks parameters;
                nothing has been changed then.
        """
        state = {key.removeprefix("module."): value for key, value in loaded_state.items()}
        self.load_state_dict(state)
        self.model.update_to_step(step)

    def load_state_dict(self, state_dict: Mapping[str, Any], strict: bool | None = None) -> None:
        """Always strict: nerfstudio 1.1.5 retries `strict=False`, which hides missing parameters.

        Raises:
            CheckpointError: as `load_pipeline`.
        """
        self._check_state(state_dict)
        try:
            super().load_state_dict(state_dict, strict=True)
        except RuntimeError as error:
            raise CheckpointError(
                f"The checkpoint does not fit this model: {error}. Load it with the options of "
                "the run that saved it, which stand in that run's config.yml."
            ) from error

    def _check_state(self, state: Mapping[str, Any]) -> None:
        saved = SceneRecord.from_state(state.get("_extra_state"))
        check_same_scene(saved, self.scene_record())
        found = {key.replace("_model.module.", "_model.") for key in state}
        needed = {key.replace("_model.module.", "_model.") for key in self.state_dict()}
        if found != needed:
            raise CheckpointError(
                f"The checkpoint does not fit this model: {_listed('missing', needed - found)}, "
                f"{_listed('unexpected', found - needed)}. It is damaged or was saved by another "
                "version; load an earlier one with `--load-step`, or train anew."
            )


def _listed(label: str, keys: set[str]) -> str:
    first = ", ".join(sorted(keys)[:MAX_KEYS_LISTED]) + (", ..." * (len(keys) > MAX_KEYS_LISTED))
    return f"{len(keys)} {label} parameters" + (f" ({first})" if keys else "")


def _check_finite(images: list[ScoredImage]) -> None:
    bad = [i.name for i in images if not all(math.isfinite(v) for v in i.metrics.values())]
    if bad:
        raise DeSplatError(
            f"The renderings of {len(bad)} of {len(images)} images hold values that are not "
            f"finite, the first being '{bad[0]}'. Training has diverged; evaluate an earlier "
            "checkpoint by setting `load_step` in the run's config.yml, or train with lower "
            "learning rates."
        )


def _save(pictures: dict[str, torch.Tensor], folder: Path | None, pattern: str) -> None:
    """Write pictures [H, W, 3] in [0, 1] as PNG, under upstream's names."""
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for key, picture in pictures.items():
        save_image(picture.permute(2, 0, 1).cpu(), folder / pattern.format(key))
