"""Training pipeline: evaluation that says what it measured, checkpoints that fit or say why not."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, cast, runtime_checkable

import torch
from nerfstudio.pipelines.base_pipeline import VanillaPipeline, VanillaPipelineConfig
from nerfstudio.viewer.viewer_elements import ViewerDropdown, ViewerSlider
from torch import nn

from desplat_ns.backend import Rasterizer
from desplat_ns.console import list_names, progress_over
from desplat_ns.data.training_views import image_names
from desplat_ns.datamanager import DeSplatDataManager
from desplat_ns.effects import Effects
from desplat_ns.errors import CaptureError, CheckpointError
from desplat_ns.evaluation.config import EvaluationConfig, chosen_protocol
from desplat_ns.evaluation.halves import RightHalf, RightHalfByLeft, ScoredLitModel
from desplat_ns.evaluation.mask_scores import MaskedModel, score_masks
from desplat_ns.evaluation.metrics import LPIPS_NET, LazyLpips
from desplat_ns.evaluation.pictures import save_pictures
from desplat_ns.evaluation.protocol import EvaluationProtocol
from desplat_ns.evaluation.records import (
    ScoredImage,
    check_finite,
    gaussian_counts,
    per_image,
    summarize,
    versions,
)
from desplat_ns.evaluation.whole_image import WholeImage
from desplat_ns.gaussians.distractors import DistractorGaussians
from desplat_ns.lit_model import LitModelConfig
from desplat_ns.nerfstudio_quirks import (
    give_masks_a_colormap_in_the_viewer,
    load_evaluated_checkpoints_like_resumed_ones,
    where_to_render,
)
from desplat_ns.photo_tourism.image_effects import ImageEffects
from desplat_ns.photo_tourism.shown_light import ShownLight
from desplat_ns.training.checkpoint_record import SceneRecord, check_same_scene
from desplat_ns.training.step_guard import GuardedModel
from desplat_ns.viewer import FirstPhotoView, LayerControl

MAX_KEYS_LISTED = 5
"""Parameters that an error message names before it only counts."""


@dataclass
class DeSplatPipelineConfig(VanillaPipelineConfig):
    """Configuration of the pipeline."""

    _target: type = field(default_factory=lambda: DeSplatPipeline)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    """How `ns-eval` scores images."""


@runtime_checkable
class PipelineModel(ScoredLitModel, MaskedModel, GuardedModel, Protocol):
    """What the pipeline needs of a model; `DeSplatModel` has it."""

    layer_control: LayerControl
    """The viewer's choice of layer."""
    shown_light: ShownLight
    """The choice of a light."""
    gauss_params: nn.ParameterDict
    """Of the static set."""
    effects: Effects
    image_effects: ImageEffects | None
    lpips: LazyLpips

    @property
    def distractors(self) -> DistractorGaussians | None:
        """Those of all training views; None if the effect is off."""
        ...

    @property
    def rasterizer(self) -> Rasterizer:
        """The backend."""
        ...

    def update_to_step(self, step: int) -> None:
        """Take up a checkpoint's step."""
        ...


class DeSplatPipeline(VanillaPipeline):
    """nerfstudio's pipeline with its own evaluation and strict loading."""

    config: DeSplatPipelineConfig
    datamanager: DeSplatDataManager
    _model: PipelineModel
    pictured: Collection[int] | None = None
    """Numbers of the images whose pictures an evaluation writes; None: all of them."""

    def __init__(
        self,
        config: DeSplatPipelineConfig,
        device: str | torch.device,
        test_mode: Literal["test", "val", "inference"] = "val",
        **kwargs: Any,
    ) -> None:
        """nerfstudio's; a trained model whose backend cannot draw on `device` goes to the CPU."""
        if test_mode != "val":  # else it is trained, on the device that was asked for
            device = where_to_render(cast(LitModelConfig, config.model).backend, device)
        super().__init__(config, str(device), test_mode, **kwargs)
        self.datamanager.train_dataset.check_sides(self._model.config.num_downscales)
        self.datamanager.eval_dataset.check_sides(0)
        self.first_photo_view = FirstPhotoView(self.datamanager.train_dataset.cameras)
        give_masks_a_colormap_in_the_viewer()
        load_evaluated_checkpoints_like_resumed_ones()

    # --- viewer ------------------------------------------------------------------------------

    @property
    def layer(self) -> ViewerDropdown | None:
        """The viewer's choice of layer; None where there are no distractors."""
        control = self._model.layer_control
        return control.layer if control.num_views > 0 else None

    @property
    def training_view(self) -> ViewerSlider | None:
        """The viewer's choice of whose distractors to show; None where there are none."""
        control = self._model.layer_control
        return control.view if control.num_views > 0 else None

    @property
    def appearance(self) -> ViewerDropdown | None:
        """The viewer's choice of whose light is shown; None where there is no appearance model."""
        shown_light = self._model.shown_light
        return shown_light.first if shown_light.names else None

    @property
    def appearance_mixed(self) -> ViewerDropdown | None:
        """The viewer's choice of a second image to mix in; None as above."""
        shown_light = self._model.shown_light
        return shown_light.second if shown_light.names else None

    @property
    def appearance_share(self) -> ViewerSlider | None:
        """The viewer's share of the second image; None as above."""
        shown_light = self._model.shown_light
        return shown_light.share if shown_light.names else None

    @contextmanager
    def _static_scene(self) -> Iterator[None]:
        with self._model.layer_control.suspended(), self._model.shown_light.suspended():
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
            ConfigError: the protocol does not fit the model.
            DeSplatError: called by `ns-eval`, and a figure of an image is not a finite number.
        """
        self.eval()
        with self._static_scene():
            protocol = self._protocol() if get_std else WholeImage(self._model)
            images = self._score_images(
                data_loader, image_prefix, output_path, protocol, warm_up=get_std
            )
            results: dict[str, Any] = {**summarize(images, get_std)}
            results |= gaussian_counts(self._model.gauss_params, self._model.distractors)
            if get_std:
                check_finite(images)
                results |= self._mask_scores()
                results |= self._texts()
                results["protocol"] = protocol.describe()
                results["images"] = per_image(images)
        self.train()
        return results

    def _protocol(self) -> EvaluationProtocol:
        config, model = self.config.evaluation, self._model
        makers: dict[str, Callable[[], EvaluationProtocol]] = {
            "full": lambda: WholeImage(model),
            "right": lambda: RightHalf(model),
            "half": lambda: RightHalfByLeft(model, config),
        }
        return makers[chosen_protocol(config, model.effects.image_light)]()

    def _score_images(
        self,
        data_loader: Any,
        prefix: str,
        output_path: Path | None,
        protocol: EvaluationProtocol,
        warm_up: bool,
    ) -> list[ScoredImage]:
        loader = list(data_loader)
        if not loader:
            raise CaptureError(
                "The capture has no evaluation images, so there is nothing to score. Choose a "
                "split that has some, with the data parser's `--eval-mode` or its split options."
            )
        if warm_up:  # compilation and caches are no part of the time per image
            self._model.get_outputs_for_camera(loader[0][0])
        names = image_names(self._photos(prefix))
        images: list[ScoredImage] = []
        with progress_over(len(loader), "Evaluating all images...") as advance:
            for index, (camera, batch) in enumerate(loader):
                name = names[int(batch.get("image_idx", index))]
                scored, pictures = protocol.score(camera, batch, name)
                images.append(scored)
                if self.pictured is None or index in self.pictured:
                    save_pictures(pictures, output_path, f"{prefix}_{{}}_{index:04d}.png")
                advance()
        return images

    def _photos(self, prefix: str) -> list[Path]:
        manager = self.datamanager
        dataset = manager.eval_dataset if prefix == "eval" else manager.train_dataset
        return [Path(name) for name in dataset.image_filenames]

    def _mask_scores(self) -> dict[str, int | float]:
        if self._model.distractors is None:
            return {}
        return score_masks(self._model, self.datamanager.true_masks())

    def _texts(self) -> dict[str, Any]:
        model = self._model
        texts: dict[str, Any] = {
            "backend": model.rasterizer.name,
            "device": str(self.device),
            "versions": versions(),
        }
        reason = model.lpips.reason
        return texts | ({"lpips_net": LPIPS_NET} if reason is None else {"lpips_reason": reason})

    # --- checkpoints -------------------------------------------------------------------------

    def scene_record(self) -> SceneRecord:
        """What a checkpoint of this pipeline belongs to."""
        model, names = self._model, self.datamanager.train_image_names
        return SceneRecord(asdict(model.effects), model.config.sh_degree, names)

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
        self.load_state_dict(loaded_state)
        self._model.update_to_step(step)

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
        found, needed = set(state), set(self.state_dict())
        if found != needed:
            raise CheckpointError(
                f"The checkpoint does not fit this model: {_listed('missing', needed - found)}, "
                f"{_listed('unexpected', found - needed)}. It is damaged or was saved by another "
                "version; load an earlier one with `--load-step`, or train anew."
            )


def _listed(label: str, keys: set[str]) -> str:
    named = f" ({list_names(sorted(keys), MAX_KEYS_LISTED)})" if keys else ""
    return f"{len(keys)} {label} parameters{named}"
