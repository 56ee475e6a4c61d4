"""What an effect costs in training, as far as it can be said before."""

from __future__ import annotations

STEP_RATIOS: dict[tuple[str, str | bool], float] = {
    ("distractors", True): 1.15,
    ("appearance", "camera"): 1.06,
    ("appearance", "affine"): 2.4,
    ("background", "constant"): 1.07,
    ("background", "sh"): 1.1,
    ("background", "image"): 1.1,
}
"""Time of a training step with the effect over one with none, 100,000 Gaussians and 648 x 420
pixels on one CPU thread (docs/photo_tourism.md, What it costs; the least of seven turns, or the
median for affine). Distractors: of a photo in which nothing is in the way; those that are there are
drawn as well. Elsewhere the ratios differ, on a GPU most of all."""

MEMORY: dict[tuple[str, str | bool], str] = {
    ("distractors", True): "at most a quarter of the static scene's memory in the scenes measured",
    ("appearance", "camera"): "60 bytes a photo",
    ("appearance", "affine"): "288 bytes a static Gaussian, 384 a photo, 0.3 MB",
    ("background", "constant"): "36 bytes",
    ("background", "sh"): "900 bytes",
    ("background", "image"): "0.6 MB, 384 bytes a photo",
}
"""Parameters and their Adam moments, float32."""


def cost_of(effect: str, decision: str | bool) -> str:
    """What a decision costs, in words."""
    ratio = STEP_RATIOS.get((effect, decision))
    if ratio is None:
        return "nothing"
    return (
        f"a step takes some {ratio:g} times as long (measured on a CPU); {MEMORY[effect, decision]}"
    )
