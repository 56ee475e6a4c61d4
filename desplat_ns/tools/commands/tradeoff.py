"""`desplat-tradeoff`: what accuracy costs in time on a capture, measured on this machine."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.schedule import seconds_of
from desplat_ns.tools.commands import run_on_capture


@dataclass
class Arguments:
    """Measure what accuracy costs in time: lengths, sizes of photos, effects.

    A data parser's name and its options may follow, as in ns-train; without them the capture's
    layout is recognised. `ns-train desplat colmap --help` lists the options of colmap.
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture."""
    time: str = "30min"
    """Wall time for the whole study, earlier sessions included."""
    output: Path = Path("tradeoff")
    """Folder for the report, records.jsonl and the runs. What is there already is gone on with."""

    def main(self, parser: tuple[str, ...]) -> None:
        """Check what can be checked at once, then measure by a data parser of this name and
        options, or the method's own. Raises DeSplatError as `tradeoff.tradeoff`."""
        seconds = seconds_of(self.time, "--time")
        if not self.data.exists():
            raise CaptureError(f"There is no '{self.data}'. Name the folder of a capture.")

        from desplat_ns.tools.studies.tradeoff import tradeoff  # seconds: not before the checks

        page = tradeoff(self.data, parser, self.output, seconds)
        announce(f"Written: {page}")


main = partial(run_on_capture, Arguments, "desplat-tradeoff")
