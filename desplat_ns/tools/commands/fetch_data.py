"""`desplat-fetch-data`: the published data sets, downloaded and unpacked."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from desplat_ns.core.console import announce
from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.commands import run
from desplat_ns.tools.fetch.sources import SOURCES


@dataclass
class Arguments:
    """Download a published data set and unpack it; without a name, list what there is.

    A download that was broken off goes on when the same is typed again. None of these data sets is
    part of this package: the page of each says who made it, and what may be done with it.
    """

    name: Annotated[str, tyro.conf.Positional] = ""
    """Of a data set, or of a scene of Photo Tourism."""
    folder: Path = Path("data")
    """Where the data set's own folder is made."""

    def main(self) -> None:
        """List, or fetch. Raises DeSplatError where it is not known or cannot be had."""
        if not self.name:
            for name, source in SOURCES.items():
                print(name, source.title, source.page, *source.files, sep="\n    ")
            return
        if self.name not in SOURCES:
            raise ConfigError(
                f"There is no data set '{self.name}'. There are: {', '.join(SOURCES)}."
            )
        from desplat_ns.tools.fetch.fetch import fetch  # a second

        source = SOURCES[self.name]
        announce(f"{source.title}. Whose it is, and what may be done with it: {source.page}")
        scenes = fetch(source, self.folder)
        announce(f"{len(scenes)} in '{scenes[0].parent}': {', '.join(s.name for s in scenes)}.")
        announce(f"    {source.train.format(scene=scenes[0])}")


main = partial(run, Arguments)
