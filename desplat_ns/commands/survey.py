"""`desplat-survey`: which effects does a capture call for? Looked at before training."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from desplat_ns.commands.parser_words import data_parser, parse
from desplat_ns.errors import CaptureError, ConfigError, print_user_errors_plainly
from desplat_ns.files.whole import check_new_file

if TYPE_CHECKING:  # seconds: not before the options are checked
    from desplat_ns.survey.findings import Survey

WRITTEN = ("survey.json", "survey.png")


@dataclass
class Arguments:
    """Say which effects a capture calls for, before any training.

    A data parser's name and its options may follow, as in ns-train: colmap, nerfstudio-data,
    robustnerf-data, photo-tourism-data, on-the-go-data, or another of nerfstudio's. Without them
    the capture's layout is recognised, as there. `desplat-survey DATA colmap --help` lists the
    options of colmap.
    """

    data: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="DATA")] = None
    """Folder of the capture; `--data DATA`, as in ns-train, says the same."""
    output: Path = Path("survey")
    """Folder for survey.json (the findings) and survey.png (a sheet of the evidence)."""
    overwrite: bool = False
    """Replace these two files if they are there."""
    verbose: bool = False
    """Whether to print every figure with its threshold; survey.json has them in any case."""

    def survey(self, parser: tuple[str, ...]) -> Survey:
        """Check what can be checked at once, then survey.

        Args:
            parser: name and options of a data parser; empty to have the layout recognised.

        Raises:
            CaptureError: there is no such capture, or it cannot be surveyed.
            ConfigError: no capture is named, or the files in `output` are there already or cannot
                be written.
        """
        if self.data is None:
            raise ConfigError("No capture is named. Type: desplat-survey FOLDER.")
        if not self.data.exists():
            raise CaptureError(f"There is no '{self.data}'. Name the folder of a capture.")
        for name in WRITTEN:
            check_new_file(self.output / name, self.overwrite)

        from desplat_ns.commands.surveyed import survey_capture

        chosen = data_parser("desplat-survey", parser) if parser else None
        return survey_capture(self.data, self.output, chosen, self.verbose)


def main() -> None:
    """Entry point of the command."""
    print_user_errors_plainly()
    arguments, parser = parse(Arguments, "desplat-survey", sys.argv[1:])
    arguments.survey(parser)


if __name__ == "__main__":
    main()
