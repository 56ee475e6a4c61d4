"""`desplat-reproduce`: a table of the paper, trained and scored here, with the paper's beside."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.core.options import check_ranges, ranged
from desplat_ns.tools.commands import run
from desplat_ns.tools.studies.paper import METHODS, TABLES, Method, TableName


@dataclass
class Arguments:
    """Train and score what a table of the paper needs, and write it with the paper's figures
    beside, as Markdown and JSON.

    What is done already in the output folder is gone on with; A7 shares the runs of the
    tables of its data sets there. `desplat-fetch-data` downloads the data sets.
    """

    table: Annotated[TableName, tyro.conf.Positional]
    """robustnerf, on-the-go: PSNR, SSIM, LPIPS. A5: Photo Tourism. A6: Mip-NeRF 360. A7: memory."""
    data: Path = Path("data")
    """Folder with the data sets, as `desplat-fetch-data` makes it."""
    output: Path = Path("reproduced")
    """Folder for the tables and what is trained."""
    methods: tuple[str, ...] = ()
    """That are compared, without any those of the table; also others that ns-train knows."""
    seeds: int = ranged(1, "[1, inf)")
    """Trainings of each method on each scene, whose figures are averaged."""
    smoke: bool = False
    """Try everything in minutes: 100 steps, photos of 160 pixels. The figures mean nothing."""

    def main(self) -> None:
        """Check what can be checked at once, then make the table, say where it is. Raises
        DeSplatError where an option cannot be, or as `reproduce.reproduce`."""
        check_ranges(self)
        table = TABLES[self.table]
        if not self.data.is_dir():
            raise CaptureError(
                f"There is no folder '{self.data}'. Name that with the data sets by --data; "
                "`desplat-fetch-data` lists what there is and downloads it."
            )

        from nerfstudio.configs.method_configs import all_methods

        from desplat_ns.tools.studies.methods import method_config  # seconds: not before the checks
        from desplat_ns.tools.studies.reproduce import Smoke, reproduce

        names = list(dict.fromkeys(self.methods or table.methods))
        if unknown := [name for name in names if name not in {*METHODS, *all_methods}]:
            known = ", ".join(METHODS)
            raise ConfigError(f"--methods names '{unknown[0]}'. There are {known}, and ns-train's.")
        methods = tuple(METHODS.get(name, Method(name, name)) for name in names)
        if not self.smoke and method_config("desplat").machine.device_type == "cpu":
            raise ConfigError(
                "This machine has no GPU, on which the runs are meant to be done. Add --smoke to "
                "try the same with few steps and small photos."
            )
        smoke = Smoke() if self.smoke else None
        folder = reproduce(table, self.data, self.output, methods, self.seeds, smoke)
        announce(f"Written: {folder / 'table.md'}, and table.json beside it.")


main = partial(run, Arguments)
