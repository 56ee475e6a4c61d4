"""From a run to its scene's page: loads it, gathers, writes, says what was written."""

from __future__ import annotations

from pathlib import Path

from desplat_ns.console import announce
from desplat_ns.files.whole import plain_errors, write_whole
from desplat_ns.runs.files import RunFiles
from desplat_ns.runs.loading import load_run
from desplat_ns.scene.gather import gather
from desplat_ns.scene.page import html_of

MEGABYTE = 1_000_000


def write_scene(
    files: RunFiles,
    output: Path,
    most_training: int,
    most_held_out: int,
    megabytes: float,
    crop: float | None,
    light: str | None,
) -> int:
    """Write the page of a run's scene; its size in bytes.

    Args: see `desplat-export page --help`.

    Raises:
        CaptureError: the capture cannot be read any more, or has no camera to start from.
        CheckpointError: no checkpoint is intact.
        ConfigError: an unknown light, nothing left to show, or the page cannot be written.
    """
    contents = gather(load_run(files), most_training, most_held_out, crop, light)
    text, left_out = html_of(contents, int(megabytes * MEGABYTE))
    with plain_errors(output):
        write_whole(output, text.encode())
    size = len(text.encode())
    announce(f"Saved {output}: a page with the scene in it, {size / MEGABYTE:.1f} MB.")
    for line in left_out:
        announce(line, warning=True)
    return size
