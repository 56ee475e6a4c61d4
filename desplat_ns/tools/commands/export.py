"""`desplat-export`: a trained run in the files that viewers and other trainers read."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from desplat_ns.core.errors import ConfigError
from desplat_ns.core.options import ranged
from desplat_ns.core.whole import check_new_file, check_new_folder
from desplat_ns.tools.commands import OfRun, run
from desplat_ns.tools.export.formats import FrameName, Naming, format_of


@dataclass(kw_only=True)
class OfScene(OfRun):
    """What `splats` and `page` share."""

    crop: float | None = ranged(None, "(0, inf)")
    """Keep what is at most so many times as far from a camera as that camera looks (the median
    depth of what it shows); 2 keeps the scene and drops what floats far beyond it."""
    light: str | None = None
    """Whose light is shown, as `photo.jpg`; else the average."""
    overwrite: bool = False
    """Replace the file if it is there."""


@dataclass(kw_only=True)
class Splats(OfScene):
    """Write the static scene, without distractors, as splats: .ply or .spz.

    Free programs: SuperSplat, to crop and clean a .ply or .spz in a browser; Brush, to look at a
    .ply on computers, Android and in Chrome.
    """

    output: Path
    """The file. Its ending chooses the format: .ply (everything reads it), .spz (an eighth of
    its size, rounded)."""
    frame: FrameName = "upright"
    """upright: as viewers expect it of the format, in the capture's scale. capture: the capture's
    own coordinates, to lay over its points. training: nerfstudio's, as ns-export."""

    def main(self) -> None:
        """Check what can be checked at once, then load and write. Raises DeSplatError."""
        format_of(self.output)
        files = self.find()
        check_new_file(self.output, self.overwrite)

        from desplat_ns.tools.export.export import export_splats  # seconds

        export_splats(files, self)


@dataclass(kw_only=True)
class Masks(OfRun):
    """Write the distractor mask of every training photo as PNG, at the photo's full size.

    Black is what is to be ignored, as COLMAP and nerfstudio want it.
    """

    output: Path
    """The folder; folders of the photos are kept inside it."""
    invert: bool = False
    """White where distractors are, black elsewhere."""
    dilate: float = ranged(0.0, "[0, inf)")
    """Pixels of the photo by which what is masked grows on all sides."""
    names: Naming = "colmap"
    """colmap: photo.jpg.png. nerfstudio: photo.png."""
    for_training: bool = False
    """As --masks-path of training takes them: also for held-out photos, white; what was black in
    the masks that the run was given stays black."""
    originals: Path | None = None
    """Folder of the photos that desplat-process was given: masks fit these instead."""
    overwrite: bool = False
    """Write into a folder that is not empty; files of the same name are replaced."""

    def main(self) -> None:
        """As `Splats.main`."""
        files = self.find()
        if self.for_training and (self.invert or self.originals):
            raise ConfigError("--for-training goes neither with --invert nor with --originals.")
        check_new_folder(self.output, self.overwrite)

        from desplat_ns.tools.export.masks import export_masks  # seconds

        export_masks(files, self)


@dataclass(kw_only=True)
class Page(OfScene):
    """Write the scene itself as one HTML page: to walk around in, without a server or a network."""

    output: Path
    """The page, FILE.html."""
    training_photos: int = ranged(200, "[0, inf)")
    """Training photos to go to; of more, as many evenly spread over the capture."""
    held_out_photos: int = ranged(100, "[0, inf)")
    """Held-out photos to go to, likewise."""
    megabytes: float = ranged(50.0, "(0, inf)")
    """Size of the page at most. Photos are made smaller, and Gaussians that show least are left out
    until it fits; the page says how many."""

    def main(self) -> None:
        """As `Splats.main`."""
        check_new_file(self.output, self.overwrite, ending=".html")
        files = self.find()

        from desplat_ns.tools.scene.page import write_scene  # seconds

        write_scene(files, self)


Command = (
    Annotated[Splats, tyro.conf.subcommand("splats")]
    | Annotated[Page, tyro.conf.subcommand("page")]
    | Annotated[Masks, tyro.conf.subcommand("masks")]
)
main = partial(run, Command, description=__doc__)
