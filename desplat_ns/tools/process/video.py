"""Frames of a video that are worth processing: the sharpest ones, at even distances.

Distance is how far the picture moves, in shares of its width, so that a camera that rests adds
nothing. Letters in shapes: H x W pixels."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from desplat_ns.core.console import progress_with_time_left
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.whole import draft_of
from desplat_ns.tools.process.request import MIN_PHOTOS

LOOKED_AT = (320, 180)
"""Pixels in width and height at which all frames are looked at, whatever their shape."""
STEP = 0.02
"""Of the width: when the picture has moved that far, the motion is measured from there on. Noise
and compression move it less."""
LEAST_GAP = 0.04
"""Of the width between frames that are taken: nearer ones show the same."""
COARSE, LOST, FAR = 4.0, 0.5, 0.1
"""Difference that the optical flow leaves between frames that are blurred by so many pixels, in
standard deviations of the first, from which on it found nothing: 0.01 to 0.02 where the picture
moved by 0.04 of its width or less, 0.16 at most where one frame is shaken, 0.8 to 2.6 between
frames that are a second's walk apart. And what it is taken to have moved by then."""
TEXTURED = 0.8
"""Quantile of the texture: motion is seen in the fifth of the pixels above it. A plain wall behind
an object shows none."""


@dataclass(frozen=True)
class Frame:
    """What was seen of a frame."""

    index: int
    sharpness: float
    distance: float
    """That the picture has moved since the first frame, in widths."""


def take_frames(video: Path, folder: Path, most: int) -> list[str]:
    """Write the chosen frames to `folder` as PNG, unless it is there already, whole or not at all;
    their names, in the video's order. Pixels become square by their longer side. Raises
    CaptureError where the video cannot be read, or its camera does not move."""
    if not folder.is_dir():
        seen = look_at(video)
        chosen = choose(seen, most)
        if len(chosen) < MIN_PHOTOS:
            raise CaptureError(
                f"{video} has {len(seen)} frames, in which the picture moves by "
                f"{seen[-1].distance:.0%} of its width: too little. Walk around while filming."
            )
        with draft_of(folder) as draft:
            draft.mkdir()
            wanted, aspect = {frame.index for frame in chosen}, pixel_aspect(video)
            for index, _, pixels in frames_of(video):
                if index in wanted:
                    high, wide = pixels.shape[:2]
                    size = round(wide * max(1.0, aspect)), round(high * max(1.0, 1 / aspect))
                    pixels = cv2.resize(pixels, size, interpolation=cv2.INTER_CUBIC)
                    encoded = cv2.imencode(".png", pixels)[1].tobytes()
                    (draft / f"frame_{index:06d}.png").write_bytes(encoded)
    return sorted(path.name for path in folder.iterdir())


def look_at(video: Path) -> list[Frame]:
    """What is seen of every frame. Raises as `frames_of`."""
    seen, anchor, distance = list[Frame](), None, 0.0
    with progress_with_time_left("Video") as show:
        for index, total, pixels in frames_of(video):
            small = cv2.resize(pixels, LOOKED_AT, interpolation=cv2.INTER_AREA)
            grey = cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)
            anchor = grey if anchor is None else anchor
            moved = motion(anchor, grey)
            if moved >= STEP:
                anchor, distance, moved = grey, distance + moved, 0.0
            sharpness = float(cv2.Laplacian(grey, cv2.CV_64F).var())
            seen.append(Frame(index, sharpness, distance + moved))
            show(index + 1, total)
    return seen


def motion(first: UInt8[np.ndarray, "H W"], second: UInt8[np.ndarray, "H W"]) -> float:
    """Median of the optical flow between two frames where the first has most texture, in widths;
    `FAR` where it finds nothing, as between frames that are seconds apart."""
    flow = cv2.calcOpticalFlowFarneback(
        first, second, np.zeros((*first.shape, 2), np.float32), 0.5, 3, 15, 2, 5, 1.2, 0
    )
    texture = cv2.blur(np.abs(cv2.Laplacian(first, cv2.CV_32F)), (15, 15))
    is_textured = texture >= np.quantile(texture, TEXTURED)
    rows, columns = np.indices(first.shape, np.float32)
    one, two = (cv2.GaussianBlur(i.astype(np.float32), (0, 0), COARSE) for i in (first, second))
    back = cv2.remap(two, columns + flow[..., 0], rows + flow[..., 1], cv2.INTER_LINEAR)
    left = np.abs(back - one)[is_textured].mean()
    if left > LOST * max(20.0, float(one[is_textured].std())):
        return FAR
    return float(np.median(np.linalg.norm(flow, axis=2)[is_textured])) / first.shape[1]


def choose(frames: Sequence[Frame], most: int) -> list[Frame]:
    """At most so many: the whole distance in even parts, and of each the sharpest frame."""
    whole = frames[-1].distance
    parts = min(most, int(whole / LEAST_GAP) + 1)
    best: dict[int, Frame] = {}
    for frame in frames:
        part = min(parts - 1, int(frame.distance / max(whole, 1e-9) * parts))
        if part not in best or frame.sharpness > best[part].sharpness:
            best[part] = frame
    return [best[part] for part in sorted(best)]


def pixel_aspect(video: Path) -> float:
    """Width of a pixel over its height, in upright frames; 1 where the file says nothing likely."""
    file = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    wide, high = file.get(cv2.CAP_PROP_SAR_NUM), file.get(cv2.CAP_PROP_SAR_DEN)
    if file.get(cv2.CAP_PROP_ORIENTATION_META) % 180 == 90:
        wide, high = high, wide
    return wide / high if high > 0 and 0.2 <= wide / high <= 5 else 1.0


def frames_of(video: Path) -> Iterator[tuple[int, int, np.ndarray]]:
    """The video's frames: number, how many the file says that there are, and pixels [H, W, 3] in
    blue, green and red, upright. Raises CaptureError where none can be read."""
    file = cv2.VideoCapture(str(video), cv2.CAP_FFMPEG)
    total, index = int(file.get(cv2.CAP_PROP_FRAME_COUNT)), 0
    is_there, pixels = file.read()
    while is_there:
        yield index, max(total, index + 1), pixels
        index += 1
        is_there, pixels = file.read()
    if index == 0:
        raise CaptureError(f"The video {video} cannot be read. Convert it to MP4 with H.264.")
