"""`desplat-eval`: nerfstudio's `ns-eval`, with the options of the protocol."""

import json
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from desplat_ns.core.console import announce
from desplat_ns.core.options import LpipsNet
from desplat_ns.core.whole import (
    check_new_file,
    check_new_folder,
    plain_errors,
    whole_folder,
    write_output,
)
from desplat_ns.evaluation.config import ProtocolName, in_words
from desplat_ns.tools.commands import OfRun, run


@dataclass(kw_only=True)
class Evaluate(OfRun):
    """Score a trained run and write the figures as JSON, as ns-eval does."""

    output_path: Path = Path("output.json")
    """The figures."""
    render_output_path: Path | None = None
    """Folder for the photos and the renderings beside them."""
    protocol: ProtocolName | None = None
    """half: find each image's embedding on its left half, score its right half. full: score whole
    images in the training images' average light. right: score right halves in that light, to
    compare a model without appearance with others on the same pixels. auto: half if images have a
    light of their own, else full. This and the next: without them, as saved with the run."""
    lpips_net: LpipsNet | None = None
    """Of LPIPS: alex (AlexNet) as nerfstudio, vgg (VGG16) as 3DGS and what is built on it."""
    overwrite: bool = False
    """Replace the figures if they are there, and write into a folder that is not empty."""

    def main(self) -> None:
        """Evaluate and write. Raises ConfigError where a path cannot be or is taken."""
        files, pictures = self.find(), self.render_output_path
        check_new_file(self.output_path, self.overwrite, "--output-path")
        if pictures is not None:
            check_new_folder(pictures, self.overwrite, "--render-output-path")

        from desplat_ns.tools.loading import load_run  # seconds: not before the checks

        loaded = load_run(files)
        scoring = loaded.pipeline.config.evaluation
        scoring.protocol = self.protocol or scoring.protocol
        scoring.lpips_net = self.lpips_net or scoring.lpips_net
        with ExitStack() as stack:
            folder = None
            if pictures is not None:
                stack.enter_context(plain_errors(pictures, "--render-output-path"))
                folder = stack.enter_context(whole_folder(pictures))
            results = loaded.pipeline.get_average_eval_image_metrics(
                output_path=folder, get_std=True
            )
        record = {
            "experiment_name": loaded.config.experiment_name,
            "method_name": loaded.config.method_name,
            "checkpoint": str(loaded.checkpoint),
            "results": results,
        }
        content = json.dumps(record, indent=2).encode()
        write_output(self.output_path, content, "--output-path")
        announce(f"{in_words(results)}; means of {results['num_images']} held-out photos.")
        announce(f"Scored: {results['protocol']}.")
        announce(f"Saved results to: {self.output_path}")


main = partial(run, Evaluate, description=__doc__)
