"""A page to look at while a run trains: `preview.html` in its folder, which loads itself anew."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from desplat_ns.core.console import about
from desplat_ns.core.whole import write_whole
from desplat_ns.evaluation.halves import embedding_from_left_half, right_half
from desplat_ns.metrics import psnr
from desplat_ns.tools.pages import fitted_into, template
from desplat_ns.tools.report.pictures import picture_of
from desplat_ns.tools.scene.gather import training_images
from desplat_ns.training import resume

TEMPLATE = Path(__file__).with_name("preview.html.jinja")
EVERY, COST = 60.0, 0.01
"""Seconds from one preview to the next at least, and the share of the time that they may cost."""
PAGE_BYTES = 1_000_000


class Preview:
    """Draws a held-out photo beside the scene, and the training photo with most in the way."""

    def __init__(self, path: Path, trainer: Any):
        """`trainer`: of the run, set up."""
        self.path, self.trainer, self.pipeline = path, trainer, trainer.pipeline
        self.curve: list[tuple[int, float]] = []
        """Steps, and PSNR of the right half of the held-out photo."""
        self._due = time.monotonic() + EVERY / 3  # a first look comes early

    def after_step(self, step: int) -> None:
        """Write the page where one is due; training is as without it."""
        began = time.monotonic()
        if began < self._due:
            return
        state, was_training = resume.rng_state(), self.pipeline.training
        self.pipeline.eval()
        try:
            # what cannot be drawn or written is no reason to end the training
            with self.pipeline.static_scene(), suppress(Exception):
                write_whole(self.path, self._page(step + 1).encode())
        finally:
            self.pipeline.train(was_training)
            resume.restore_rng(state)
        now = time.monotonic()
        self._due = now + max(EVERY, (now - began) / COST)

    def _page(self, step: int) -> str:
        left = self.trainer.seconds_left
        model, manager = self.pipeline.model, self.pipeline.datamanager
        held_out, covered = manager.eval_dataset, model.photos_with_distractors()
        shown: list[tuple[str, list[tuple[str, Any]]]] = []
        if len(held_out):
            number = len(held_out) // 2
            camera, batch = manager.fixed_indices_eval_dataloader[number]
            outputs = model.get_outputs_for_camera(camera)
            photo = model.photo_of(outputs, batch)
            if model.effects.image_light:
                fit = self.pipeline.config.evaluation
                with model.shown_in(embedding_from_left_half(model, camera, photo, fit)):
                    outputs = model.get_outputs_for_camera(camera)
            self.curve.append((step, psnr(right_half(outputs["rgb"]), right_half(photo))))
            name = f"{held_out.image_filenames[number].name}, which does not train"
            shown.append((name, [("photo", photo), ("scene", outputs["rgb"])]))
        if covered:
            counts = model.distractors.counts()
            number = max(range(len(counts)), key=lambda index: counts[index])
            outputs, photo = self._training_photo(number)
            pictures = [("photo", photo), ("scene", outputs["rgb_static"])]
            pictures += [("in the way", outputs["distractor_mask"].float())]
            shown.append((f"{manager.train_image_names[number]}, with most in the way", pictures))
        sources = iter(fitted_into([picture_of(i) for _, row in shown for _, i in row], PAGE_BYTES))
        return template(TEMPLATE).render(
            step=step,
            total=max(step, self.trainer.total),
            left="" if left is None else about(left),
            curve=self.curve,
            covered=len(covered),
            photos=[(title, [(what, next(sources)) for what, _ in row]) for title, row in shown],
        )

    def _training_photo(self, index: int) -> tuple[dict[str, Any], Any]:
        manager, model = self.pipeline.datamanager, self.pipeline.model
        _, camera, batch = next(training_images(manager, [index]))
        outputs = model.get_outputs_for_camera(camera.to(model.device))
        return outputs, model.photo_of(outputs, {"image": batch["image"].to(model.device)})
