"""`desplat-eval`: nerfstudio's `ns-eval`, with the options of the protocol."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from desplat_ns.console import announce
from desplat_ns.errors import ConfigError, print_user_errors_plainly
from desplat_ns.evaluation.config import EvaluationConfig, ProtocolName
from desplat_ns.runs.files import find_run


@dataclass
class Evaluate:
    """Score a trained run and write the figures as JSON, as ns-eval does."""

    load_config: Path
    """config.yml of the run."""
    output_path: Path = Path("output.json")
    """The figures."""
    render_output_path: Path | None = None
    """Folder for the photos and the renderings beside them."""
    strip: Path | None = None
    """Picture of the first test view in the light of several training photos."""
    strip_images: int = 5
    """How many."""
    protocol: ProtocolName | None = None
    """half: find each image's embedding on its left half, score its right half. full: score whole
    images in the training images' average light. right: score right halves in that light, to
    compare a model without appearance with others on the same pixels. auto: half if images have a
    light of their own, else full. This and the next four: without them, as saved with the run."""
    steps: int | None = None
    """Steps of Adam for an embedding; `appearance camera` alone takes none."""
    learning_rate: float | None = None
    """Of the embedding."""
    load_embeddings: Path | None = None
    """Take the embeddings from this file instead of finding them."""
    save_embeddings: Path | None = None
    """Write the test images' embeddings into this file (.npz)."""

    def main(self) -> None:
        """Evaluate, write, say where.

        Raises:
            ConfigError: a path that cannot be, or options that the model has no use for.
        """
        if self.output_path.suffix != ".json":
            raise ConfigError(f"--output-path is '{self.output_path}'; give it the ending .json.")
        if self.strip is not None and self.strip_images < 1:
            raise ConfigError(f"--strip-images is {self.strip_images}; a strip shows 1 or more.")
        files = find_run(self.load_config)
        from desplat_ns.runs.loading import load_run  # seconds: not before the checks

        loaded = load_run(files, self._with_protocol)
        config, pipeline = loaded.config, loaded.pipeline
        results = pipeline.get_average_eval_image_metrics(
            output_path=self.render_output_path, get_std=True
        )
        self.output_path.parent.mkdir(parents=True, exist_ok=True)
        record = {
            "experiment_name": config.experiment_name,
            "method_name": config.method_name,
            "checkpoint": str(loaded.checkpoint),
            "results": results,
        }
        self.output_path.write_text(json.dumps(record, indent=2), "utf8")
        announce(f"Saved results to: {self.output_path}")
        if self.strip is not None:
            pipeline.eval()
            self._write_strip(pipeline, self.strip)

    def _with_protocol(self, config: Any) -> Any:
        """A run's configuration with the options that were given."""
        options = {f.name: getattr(self, f.name) for f in fields(EvaluationConfig)}
        given = {name: value for name, value in options.items() if value is not None}
        config.pipeline.evaluation = replace(config.pipeline.evaluation, **given)
        return config

    def _write_strip(self, pipeline: Any, path: Path) -> None:
        from PIL import Image

        from desplat_ns.evaluation.appearance_strip import appearance_strip

        manager = pipeline.datamanager
        camera, _ = manager.fixed_indices_eval_dataloader[0]
        count = len(manager.train_dataset)
        chosen = np.unique(np.linspace(0, count - 1, self.strip_images).round().astype(int))
        photos = [manager.train_dataset.get_numpy_image(int(i))[..., :3] for i in chosen]
        name = Path(manager.eval_dataset.image_filenames[0]).name
        picture = appearance_strip(pipeline.model, camera, name, [int(i) for i in chosen], photos)
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(picture).save(path)
        announce(f"Saved the strip to: {path}")


def main() -> None:
    """Entry point of the command."""
    print_user_errors_plainly()
    tyro.cli(Evaluate, description=__doc__).main()
