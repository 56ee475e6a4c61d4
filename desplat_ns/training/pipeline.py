"""Training pipeline: evaluation that says what it measured, checkpoints that fit or say why not."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, cast

import torch
from nerfstudio.pipelines.base_pipeline import VanillaPipeline, VanillaPipelineConfig
from torch import Tensor
from torchvision.utils import save_image

from desplat_ns.core.console import announce
from desplat_ns.core.cores import leave_cores_to_others
from desplat_ns.core.errors import CheckpointError
from desplat_ns.core.run_files import found
from desplat_ns.data.training_views import image_names
from desplat_ns.evaluation.config import EvaluationConfig, in_words
from desplat_ns.evaluation.evaluate import Show, evaluate, evaluate_in_training
from desplat_ns.model import DeSplatModel
from desplat_ns.model_config import DeSplatModelConfig
from desplat_ns.plugin import (
    give_masks_a_colormap_in_the_viewer,
    load_evaluated_checkpoints_like_resumed_ones,
    use_ffmpeg_of_imageio,
    where_to_render,
)
from desplat_ns.training.datamanager import DeSplatDataManager
from desplat_ns.training.resume import SceneRecord


@dataclass
class DeSplatPipelineConfig(VanillaPipelineConfig):
    """Configuration of the pipeline."""

    _target: type = field(default_factory=lambda: DeSplatPipeline)
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    """How `ns-eval` scores images."""


class DeSplatPipeline(VanillaPipeline):
    """nerfstudio's pipeline with its own evaluation and strict loading."""

    config: DeSplatPipelineConfig
    datamanager: DeSplatDataManager
    _model: DeSplatModel
    is_logged = True
    """Whether anybody is told the figures of the training step at hand."""

    def __init__(
        self,
        config: DeSplatPipelineConfig,
        device: str | torch.device,
        test_mode: Literal["test", "val", "inference"] = "val",
        **kwargs: Any,
    ) -> None:
        """nerfstudio's; a trained model whose backend cannot draw on `device` goes to the CPU."""
        if test_mode != "val":  # else it is trained, on the device that was asked for
            if Path(sys.argv[0]).stem == "ns-render":
                use_ffmpeg_of_imageio()
            device = where_to_render(cast(DeSplatModelConfig, config.model).backend, device)
            config.datamanager.data = config.datamanager.data and found(config.datamanager.data)
        if torch.device(device).type == "cpu":
            leave_cores_to_others()
        super().__init__(config, str(device), test_mode, **kwargs)
        give_masks_a_colormap_in_the_viewer()
        load_evaluated_checkpoints_like_resumed_ones()

    def start_model_anew(self) -> None:
        """Make the model again, by the settings as they are now; it has learned nothing."""
        old = self._model
        self._model = self.config.model.setup(
            scene_box=old.scene_box,
            num_train_data=old.num_train_data,
            seed_points=old.seed_points,
            **old.kwargs,
        )
        self._model.to(old.device)

    @property
    def model(self) -> DeSplatModel:
        """The model; nerfstudio's would look for several processes, and there is one."""
        return self._model

    def get_train_loss_dict(self, step: int) -> tuple[Any, dict[str, Any], dict[str, Any]]:
        """nerfstudio's; figures are worked out in steps that are logged."""
        camera, batch = self.datamanager.next_train(step)
        outputs = self._model(camera)
        figures = self._model.get_metrics_dict(outputs, batch) if self.is_logged else {}
        return outputs, self._model.get_loss_dict(outputs, batch, figures), figures

    # --- evaluation --------------------------------------------------------------------------

    @contextmanager
    def static_scene(self) -> Iterator[None]:
        """Within, the static scene is drawn, outside of training and whatever an open viewer
        shows."""
        was_training = self.training
        self.eval()
        try:
            with self._model.layer_control.suspended(), self._model.shown_light.suspended():
                yield
        finally:
            self.train(was_training)

    def get_average_image_metrics(
        self,
        data_loader: Any,
        image_prefix: str,
        step: int | None = None,
        output_path: Path | None = None,
        get_std: bool = False,
    ) -> dict[str, Any]:
        """`evaluate` where `get_std`, by which nerfstudio 1.1.5 marks a call by `ns-eval`, else
        `evaluate_in_training`. `output_path`: a folder for pictures of photo and rendering."""
        manager = self.datamanager
        split = manager.eval_dataset if image_prefix == "eval" else manager.train_dataset

        def save(index: int, beside: Tensor) -> None:
            if output_path is not None:
                output_path.mkdir(parents=True, exist_ok=True)
                path = output_path / f"{image_prefix}_img_{index:04d}.png"
                save_image(beside.permute(2, 0, 1).cpu(), path)

        results = self._evaluated(data_loader, split.image_filenames, save, in_full=get_std)
        if step is not None and image_prefix == "eval" and "psnr" in results:
            photos = f"{results['num_images']} held-out photos"
            announce(f"Step {step:,}: {in_words(results)} on {photos}.")
        return results

    def evaluate_held_out(self, show: Show) -> dict[str, Any]:
        """What `ns-eval` writes of the held-out photos; `show` gets their pictures. Raises as
        `evaluate`."""
        manager = self.datamanager
        paths = manager.eval_dataset.image_filenames
        return self._evaluated(manager.fixed_indices_eval_dataloader, paths, show, in_full=True)

    def _evaluated(
        self, data_loader: Any, paths: Sequence[Path], show: Show, in_full: bool
    ) -> dict[str, Any]:
        images, names = data_loader, image_names([Path(path) for path in paths])
        with self.static_scene():
            if not in_full:
                return evaluate_in_training(self._model, images, names, show)
            masks = self.datamanager.gt_masks()
            return evaluate(self._model, self.config.evaluation, images, names, masks, show)

    # --- checkpoints -------------------------------------------------------------------------

    def scene_record(self) -> SceneRecord:
        """What a checkpoint of this pipeline belongs to."""
        model, manager = self._model, self.datamanager
        effects, degree = asdict(model.effects), model.config.sh_degree
        return SceneRecord(effects, degree, manager.train_image_names, manager.remembered())

    def get_extra_state(self) -> dict[str, Any]:
        """The scene record, for the checkpoint."""
        return asdict(self.scene_record())

    def set_extra_state(self, state: object) -> None:
        """Nothing: the record was compared before."""

    def load_pipeline(self, loaded_state: dict[str, Any], step: int) -> None:
        """Load a checkpoint's pipeline as it stood after `step`. Raises CheckpointError where it
        does not fit; where it belongs to another scene or other effects, nothing is changed."""
        self.load_state_dict(loaded_state)
        self._model.step = step  # it decides on the SH degree

    def load_state_dict(self, state_dict: Mapping[str, Any], strict: bool | None = None) -> None:
        """Always strict: nerfstudio 1.1.5 retries `strict=False`, which hides missing parameters.
        Raises as `load_pipeline`."""
        saved = SceneRecord.from_state(state_dict.get("_extra_state"))
        saved.check_fits(self.scene_record())
        try:
            super().load_state_dict(state_dict, strict=True)
        except (RuntimeError, KeyError) as error:
            raise CheckpointError(
                f"The checkpoint does not fit this model: {error}. Load it with "
                "the options of the run that saved it, which stand in that run's config.yml; if it "
                "is of another version, train anew."
            ) from error
