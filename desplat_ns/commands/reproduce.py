"""`desplat-reproduce`: a table of the paper, trained and scored here, with the paper's beside."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from desplat_ns.console import announce
from desplat_ns.errors import CaptureError, print_user_errors_plainly
from desplat_ns.reproduce.methods import method_of
from desplat_ns.reproduce.protocols import Smoke
from desplat_ns.reproduce.tables import TABLES, TableName
from desplat_ns.settings.options import check_ranges, ranged
from desplat_ns.studies.executors import Executor, ExecutorName

if TYPE_CHECKING:  # seconds: not before the options are checked
    from desplat_ns.reproduce.grid import Request


@dataclass
class Arguments:
    """Train and score what a table of the paper needs, and write it with the paper's figures
    beside, as Markdown and JSON.

    What is done already in the output folder is gone on with; tables of the same runs (A7, A8, A9)
    share them there. `desplat-fetch-data` downloads the data sets.
    """

    table: Annotated[TableName, tyro.conf.Positional]
    """robustnerf, on-the-go: PSNR, SSIM, LPIPS. fig9: RobustNeRF by the share of cluttered photos.
    A5: Photo Tourism. A6: Mip-NeRF 360. A7: memory. A8: training time. A9: rendering speed."""
    data: Path = Path("data")
    """Folder with the data sets, as `desplat-fetch-data` makes it."""
    output: Path = Path("reproduced")
    """Folder for the tables and what is trained."""
    methods: tuple[str, ...] = ()
    """That are compared, without any those of the table; `module:attribute` of a
    MethodSpecification names one of others."""
    seeds: int = ranged(1, "[1, inf)")
    """Trainings of each method on each scene, whose figures are averaged."""
    executor: ExecutorName = "local"
    """Where trainings are done: here, or on Ray."""
    ray_address: str | None = None
    """Of a cluster; without one Ray is started here."""
    jobs: int = ranged(1, "[1, inf)")
    """Trainings beside each other. Times and speeds (A8, A9) are to be measured alone."""
    smoke: bool = False
    """Try everything in minutes: 100 steps, photos of 160 pixels at most, whatever scenes are
    there. The figures mean nothing."""

    def request(self) -> Request:
        """What is to be done.

        Raises:
            CaptureError: there is no data folder.
            ConfigError: an option cannot be.
        """
        check_ranges(self)
        table = TABLES[self.table]
        methods = tuple(map(method_of, dict.fromkeys(self.methods or table.methods)))
        if not self.data.is_dir():
            raise CaptureError(
                f"There is no folder '{self.data}'. Name that with the data sets by --data; "
                "`desplat-fetch-data` lists what there is and downloads it."
            )
        executor = Executor(self.executor, self.jobs, self.ray_address)

        from desplat_ns.reproduce.grid import Request
        from desplat_ns.studies.methods import method_config

        device = (
            method_config("desplat").machine.device_type if self.ray_address is None else "cuda"
        )
        smoke = Smoke() if self.smoke else None
        places = (self.data, self.output)
        return Request(table, *places, methods, self.seeds, executor, device, smoke)


def main() -> None:
    """Entry point of the command."""
    print_user_errors_plainly()
    request = tyro.cli(Arguments, prog="desplat-reproduce").request()

    from desplat_ns.reproduce.grid import reproduce

    folder = reproduce(request)
    announce(f"Written: {folder / 'table.md'}, and table.json beside it.")


if __name__ == "__main__":
    main()
