"""Frames of a video that are worth processing: the sharpest ones, at even distances.

Distance is how far the picture moves, in shares of its width, so that a camera that rests adds
nothing. ffmpeg comes with imageio-ffmpeg, an extra. Letters in shapes: H x W pixels.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from desplat_ns.errors import BackendUnavailableError, CaptureError
from desplat_ns.process.request import MIN_PHOTOS

LOOKED_AT = (320, 180)
"""Pixels in width and height at which all frames are looked at, whatever their shape."""
STEP = 0.02
"""Of the width: when the picture has moved that far, the motion is measured from there on. Noise
and compression move it less."""
LEAST_GAP = 0.04
"""Of the width between frames that are taken: nearer ones show the same."""


@dataclass(frozen=True)
class Frame:
    """What was seen of a frame."""

    index: int
    sharpness: float
    distance: float
    """That the picture has moved since the first frame, in widths."""


def take_frames(
    video: Path, folder: Path, most: int, progress: Callable[[int, int], None]
) -> list[str]:
    """Write the chosen frames to `folder` as PNG, unless it is there already; whole or not at all.

    Returns:
        Their names, in the video's order.

    Raises:
        BackendUnavailableError: imageio-ffmpeg is not installed.
        CaptureError: the video cannot be read, or its camera does not move.
    """
    if not folder.is_dir():
        if importlib.util.find_spec("imageio_ffmpeg") is None:
            raise BackendUnavailableError(
                "A video needs ffmpeg. Type: pip install 'desplat-ns[video]', or take frames out "
                "of it by another program and name their folder."
            )
        frames = list(look_at(video, progress))
        chosen = choose(frames, most)
        if len(chosen) < MIN_PHOTOS:
            moved = frames[-1].distance if frames else 0.0
            raise CaptureError(
                f"{video} has {len(frames)} frames, in which the picture moves by {moved:.0%} of "
                f"its width: too little for {MIN_PHOTOS} photos from different places. Depth is "
                "seen from different places only: walk around while filming."
            )
        _write(video, folder, [frame.index for frame in chosen])
    return sorted(path.name for path in folder.iterdir())


def look_at(video: Path, progress: Callable[[int, int], None]) -> Iterator[Frame]:
    """Every frame, small.

    Raises:
        CaptureError: ffmpeg cannot read the video.
    """
    total = _frame_count(video)
    anchor, distance = None, 0.0
    for index, grey in enumerate(_small_frames(video)):
        anchor = grey if anchor is None else anchor
        moved = motion(anchor, grey)
        if moved >= STEP:
            anchor, distance, moved = grey, distance + moved, 0.0
        progress(min(index + 1, total), total)
        yield Frame(index, float(cv2.Laplacian(grey, cv2.CV_64F).var()), distance + moved)


def motion(first: UInt8[np.ndarray, "H W"], second: UInt8[np.ndarray, "H W"]) -> float:
    """How far the picture moves between two frames: the median of optical flow, in widths."""
    flow = cv2.calcOpticalFlowFarneback(
        first, second, np.zeros((*first.shape, 2), np.float32), 0.5, 3, 15, 2, 5, 1.2, 0
    )
    return float(np.median(np.linalg.norm(flow, axis=2))) / first.shape[1]


def choose(frames: Sequence[Frame], most: int) -> list[Frame]:
    """At most so many: the whole distance in even parts, and of each the sharpest frame."""
    if not frames:
        return []
    whole = frames[-1].distance
    parts = min(most, int(whole / LEAST_GAP) + 1)
    best: dict[int, Frame] = {}
    for frame in frames:
        part = min(parts - 1, int(frame.distance / max(whole, 1e-9) * parts))
        if part not in best or frame.sharpness > best[part].sharpness:
            best[part] = frame
    return [best[part] for part in sorted(best)]


def _frame_count(video: Path) -> int:
    import imageio_ffmpeg

    try:
        return max(1, imageio_ffmpeg.count_frames_and_secs(str(video))[0] or 1)
    except (RuntimeError, OSError) as error:
        raise _unreadable(video, str(error)) from error


def _small_frames(video: Path) -> Iterator[np.ndarray]:
    width, height = LOOKED_AT
    options = ["-vf", f"scale={width}:{height}", "-pix_fmt", "gray", "-f", "rawvideo", "-"]
    command = [*_ffmpeg(video), "-fps_mode", "passthrough", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        while len(data := process.stdout.read(width * height)) == width * height:
            yield np.frombuffer(data, np.uint8).reshape(height, width)


def _write(video: Path, folder: Path, indices: Sequence[int]) -> None:
    part = folder.with_suffix(".part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    picked = "+".join(f"eq(n\\,{index})" for index in indices)
    command = [*_ffmpeg(video), "-fps_mode", "passthrough", "-vf", f"select='{picked}'"]
    done = subprocess.run(
        [*command, str(part / "%06d.png")], stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    written = sorted(part.iterdir())
    if done.returncode or len(written) != len(indices):
        raise _unreadable(video, done.stderr)
    for path, index in zip(written, indices, strict=True):
        path.rename(part / f"frame_{index:06d}.png")
    part.rename(folder)


def _ffmpeg(video: Path) -> list[str]:
    import imageio_ffmpeg

    return [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(video)]


def _unreadable(video: Path, problem: str) -> CaptureError:
    said = problem.strip().splitlines()
    return CaptureError(
        f"The video {video} cannot be read{f' ({said[-1]})' if said else ''}. Copy it again from "
        "its source, or convert it to MP4."
    )
