"""What an effect needs of memory. Its time depends on the machine: `calibration` measures it."""

from __future__ import annotations

MEMORY: dict[tuple[str, str | bool], str] = {
    ("distractors", True): "at most a quarter of the static scene's memory in the scenes measured",
    ("appearance", "camera"): "60 bytes a photo",
    ("appearance", "affine"): "288 bytes a static Gaussian, 384 a photo, 0.3 MB",
    ("background", "constant"): "36 bytes",
    ("background", "sh"): "900 bytes",
    ("background", "image"): "0.6 MB, 384 bytes a photo",
}
"""Parameters and their Adam moments, float32."""


def memory_of(effect: str, decision: str | bool) -> str:
    """What a decision needs, in words."""
    return MEMORY.get((effect, decision), "nothing")
