"""A page to look at while a run trains: `preview.html` in its folder, which loads itself anew."""

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from desplat_ns.core.console import about, announce
from desplat_ns.core.pages import fitted_into, picture_of, template
from desplat_ns.core.whole import write_whole
from desplat_ns.evaluation.halves import embedding_from_left_half, right_half
from desplat_ns.metrics import psnr
from desplat_ns.training import resume

TEMPLATE = Path(__file__).with_name("preview.html.jinja")
EVERY, COST, FIRST = 60.0, 0.01, 1.5
"""Seconds from one preview to the next; the share of the run's time that all may cost; and seconds
that the first may take, which reads the held-out photos: 1.5 s of CPU time on `fox_cluttered`."""
PAGE_BYTES, SIDE = 1_000_000, 0.6
"""Of the pictures on the page at most, and their share of a page's largest."""


class Preview:
    """Draws a held-out photo beside the scene, and the training photo with most in the way."""

    def __init__(self, path: Path, trainer: Any):
        """`trainer`: of the run, set up."""
        self.path, self.trainer, self.pipeline = path, trainer, trainer.pipeline
        self.curve: list[tuple[int, float]] = []
        """Steps, and PSNR of the right half of the held-out photo."""
        self._shown: dict[str, Any] = {"covered": 0, "photos": []}
        self._began = self._due = time.monotonic()
        self._spent, self._last = 0.0, FIRST

    def begin(self, step: int) -> None:
        """Write the page before there is anything to look at, and say where it is."""
        self._began = time.monotonic()
        self._due = self._began + EVERY / 3  # a first look comes early
        self._write(step)
        announce(f"To look at meanwhile: {self.path.resolve().as_uri()}")

    def after_step(self, step: int, is_evaluated: bool = False) -> None:
        """Write the page where one is due, or the scene was evaluated, and draw it anew unless that
        would cost more than `COST` of the time."""
        began = time.monotonic()
        if not (is_evaluated or began >= self._due):
            return
        whole = began - self._began + (self.trainer.seconds_left or 0.0)
        if self._spent + self._last <= COST * whole:
            self._draw(step + 1)
            self._last = time.monotonic() - began
            self._spent += self._last
        self._write(step + 1)
        self._due = time.monotonic() + EVERY

    def end(self, steps: int) -> None:
        """Draw the scene as it is, and say that the run is over; the page loads itself no more."""
        self._draw(steps)
        self._write(steps, is_over=True)

    def _draw(self, steps: int) -> None:
        # what cannot be drawn is no reason to end the training
        with resume.rng_kept(), suppress(Exception), self.pipeline.static_scene():
            self._shown = self._drawn(steps)

    def _write(self, step: int, is_over: bool = False) -> None:
        left, total = self.trainer.seconds_left, max(step, self.trainer.total)
        shown = {"step": step, "total": total, "curve": self.curve, **self._shown}
        shown["left"] = "" if left is None or is_over else about(left)
        with suppress(OSError):
            write_whole(self.path, template(TEMPLATE).render(over=is_over, **shown).encode())

    def _drawn(self, step: int) -> dict[str, Any]:
        model, manager = self.pipeline.model, self.pipeline.datamanager
        held_out, covered = manager.eval_dataset, model.photos_with_distractors()
        shown: list[tuple[str, list[tuple[str, Any]]]] = []
        if len(held_out):
            number = len(held_out) // 2
            camera, batch = manager.fixed_indices_eval_dataloader[number]
            outputs = model.get_outputs_for_camera(camera)
            photo = model.photo_of(outputs["background"], batch["image"])
            if model.effects.image_light:
                fit = self.pipeline.config.evaluation
                with model.shown_light.fixed(embedding_from_left_half(model, camera, photo, fit)):
                    outputs = model.get_outputs_for_camera(camera)
            self.curve.append((step, psnr(right_half(outputs["rgb"]), right_half(photo))))
            name = f"{held_out.image_filenames[number].name}, held out: not trained on"
            shown.append((name, [("photo", photo), ("scene", outputs["rgb"])]))
        if covered:
            counts = model.distractors.counts()
            number = max(range(len(counts)), key=lambda index: counts[index])
            _, camera, batch = next(manager.training_images([number]))
            outputs = model.get_outputs_for_camera(camera.to(model.device))
            photo = model.photo_of(outputs["background"], batch["image"])
            pictures = [("photo", photo), ("scene", outputs["rgb_static"])]
            pictures += [("in the way", outputs["distractor_mask"].float())]
            shown.append((f"{manager.train_image_names[number]}, with most in the way", pictures))
        pictures = [picture_of(image, SIDE) for _, row in shown for _, image in row]
        sources = iter(fitted_into(pictures, PAGE_BYTES))
        drawn = [(title, [(what, next(sources)) for what, _ in row]) for title, row in shown]
        return {"covered": len(covered), "photos": drawn}
