"""`desplat`: photos in, page out."""

import shlex
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.options import check_ranges
from desplat_ns.core.schedule import seconds_of
from desplat_ns.tools.commands import run


@dataclass
class PhotosToPage:
    """Make a clean, static scene of photos: poses, training, a page about it, and files.

    Stopped or killed, the same command goes on where it was. What is there already is kept.
    """

    photos: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PHOTOS")]
    """Folder of photos, with poses or without; a video; or the config.yml of a run."""
    output: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="OUTPUT")] = None
    """Folder for what comes out. Without it: desplat-NAME in the working folder."""
    budget: str = ""
    """Wall time of all parts together, for example 20min. Without it, as long as the number of
    photos asks for, which is told before the first step."""
    method: Literal["desplat", "desplat-quick", "desplat-phototourism"] = "desplat"
    """desplat-quick for a first look, in half of the time; desplat-phototourism for photos of
    tourists, whose light, sky and people all differ."""

    def main(self) -> None:
        """Check what can be checked at once, then make what is missing. Raises DeSplatError."""
        check_ranges(self)
        if not self.photos.exists():
            raise CaptureError(f"There is no '{self.photos}'. Name a folder of photos, or a video.")
        budget = seconds_of(self.budget) if self.budget else None
        source = self.photos.resolve()
        name = source.parents[2].name if source.name == "config.yml" else source.stem
        output = self.output or Path(f"desplat-{name}")
        if output.resolve().is_relative_to(source):
            raise ConfigError(
                f"'{output}' would lie among the photos. Name another folder, for example: "
                f"desplat {shlex.quote(str(self.photos))} ../{output.name}"
            )

        from desplat_ns.tools.photos_to_page import make  # seconds: not before the checks

        make(self.photos, output, self.method, budget)


main = partial(run, PhotosToPage, description=__doc__)
