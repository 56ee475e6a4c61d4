"""A capture with some of its training views only: the others, and what they alone saw, are gone."""

from pathlib import Path

import numpy as np
import PIL.Image  # noqa: F401  pycolmap 4.2.1 must not be imported before PIL: PNG writing crashed
import pycolmap


def keep_views(count: int, scene: Path, folder: Path) -> None:
    """Write the capture of `count` training views, evenly chosen, into `folder`.

    Args:
        scene: a capture of `clean_`, `clutter_` and `extra_` photos in images/, with sparse/ and
            masks/.
    """
    clutter = sorted(path.name for path in (scene / "images").glob("clutter_*"))
    chosen = np.linspace(0, len(clutter) - 1, count).round().astype(int)
    kept = {clutter[i] for i in chosen}
    kept |= {name.replace("clutter", "clean") for name in kept}
    kept |= {path.name for path in (scene / "images").glob("extra_*")}
    (folder / "images").mkdir(parents=True)
    for name in kept:
        (folder / "images" / name).symlink_to(scene / "images" / name)
    (folder / "masks").symlink_to(scene / "masks")
    (model,) = {path.parent for path in (scene / "sparse").rglob("images.*")}
    reconstruction = pycolmap.Reconstruction(model)
    for image in list(reconstruction.images.values()):
        if image.name not in kept:
            reconstruction.deregister_frame(image.frame_id)
    (folder / "sparse" / "0").mkdir(parents=True)
    reconstruction.write(folder / "sparse" / "0")
