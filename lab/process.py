"""`desplat-process` on photos whose reconstruction is known, compared with that.

    python -m lab.process PHOTOS KNOWN OUTPUT [options of desplat-process]

KNOWN is a folder with a COLMAP model (cameras.bin, images.bin, points3D.bin) of photos of the same
names.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

# PIL before pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
import PIL.Image  # noqa: F401
import pycolmap
import tyro
from jaxtyping import Float

from desplat_ns.tools.process.request import Request
from lab import parser_of


@dataclass(frozen=True)
class Comparison:
    """Camera centres of a capture beside the known ones, after the best similarity."""

    num_known: int
    missing: tuple[str, ...]
    """Photos of the known model that have no pose in the capture."""
    median: float
    """Distance of centres, as a share of the known centres' extent (the longest distance)."""
    largest: float
    worst: str
    """The photo whose distance is the largest."""


def distances(
    centres: Float[np.ndarray, "N 3"], known: Float[np.ndarray, "N 3"]
) -> Float[np.ndarray, " N"]:
    """From the known centres, after the similarity that brings all closest to them: of three
    cameras at least."""
    to_known = pycolmap.estimate_sim3d(centres, known)
    assert to_known is not None, "cameras on one line settle no similarity"
    return np.linalg.norm(to_known * centres - known, axis=1)


def compare(capture: Path, known: Path) -> Comparison:
    """How far the camera centres of a capture are from those of a known model."""
    ours, wanted = centres_of(capture / "sparse" / "0"), centres_of(known)
    names = sorted(set(ours) & set(wanted))
    there = np.stack([wanted[name] for name in names])
    off = distances(np.stack([ours[name] for name in names]), there)
    extent = np.linalg.norm(there[:, None] - there[None], axis=-1).max()
    missing = tuple(sorted(set(wanted) - set(ours)))
    worst = int(off.argmax())
    shares = off / extent
    return Comparison(
        len(wanted), missing, float(np.median(shares)), float(shares.max()), names[worst]
    )


def centres_of(model: Path) -> dict[str, Float[np.ndarray, " 3"]]:
    """Camera centres by the photos' names."""
    read = pycolmap.Reconstruction(model)
    images = (read.image(i) for i in read.reg_image_ids())
    return {image.name: image.projection_center() for image in images}


def main() -> None:
    """Process, then compare."""
    parser = parser_of("python -m lab.process", __doc__)
    for name in ("photos", "known", "output"):
        parser.add_argument(name, metavar=name.upper())
    chosen, options = parser.parse_known_args()
    tyro.cli(Request, args=[chosen.photos, chosen.output, *options]).main()
    fit = compare(Path(chosen.output), Path(chosen.known))
    print(
        f"{fit.num_known - len(fit.missing)} of the {fit.num_known} known photos have a pose"
        f"{': missing ' + ', '.join(fit.missing) if fit.missing else ''}. Camera centres are "
        f"{fit.median:.2%} (median) and {fit.largest:.2%} (largest, {fit.worst}) of the extent "
        "from the known ones."
    )


if __name__ == "__main__":
    main()
