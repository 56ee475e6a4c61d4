"""`desplat-survey`: which effects does a capture call for? Looked at before training."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from desplat_ns.core.console import announce
from desplat_ns.core.errors import CaptureError
from desplat_ns.core.whole import check_new_file, write_output
from desplat_ns.tools.commands import run_on_capture


@dataclass
class Arguments:
    """Say which effects a capture calls for, before any training.

    A data parser's name and its options may follow, as in ns-train; without them the capture's
    layout is recognised. `ns-train desplat colmap --help` lists the options of colmap.
    """

    data: Annotated[Path, tyro.conf.Positional]
    """Folder of the capture; `--data DATA`, as in ns-train, says the same."""
    output: Path = Path("survey")
    """Folder for survey.json: findings, figures, thresholds."""
    overwrite: bool = False
    """Replace this file if it is there."""

    def main(self, parser: tuple[str, ...] = ()) -> None:
        """Survey by a data parser of this name and options, or the recognised one, print and write.
        Raises DeSplatError where that cannot be; at once where that can be told."""
        if not self.data.exists():
            raise CaptureError(f"There is no '{self.data}'. Name the folder of a capture.")
        file = self.output / "survey.json"
        check_new_file(file, self.overwrite)

        from desplat_ns.data.layouts import DeSplatDataParserConfig, without_prompts
        from desplat_ns.survey.survey import survey
        from desplat_ns.training.datamanager import AnyDataParser  # seconds: checks first

        chosen: Any = DeSplatDataParserConfig()
        if parser:
            chosen = tyro.cli(AnyDataParser, prog="desplat-survey DATA", args=list(parser))
        chosen.data = self.data
        outputs = without_prompts(chosen).setup().get_dataparser_outputs("train")
        findings = survey(outputs)
        for line in findings.summary():
            announce(line)
        write_output(file, findings.to_json().encode())
        announce(f"Saved {file}.")


main = partial(run_on_capture, Arguments, "desplat-survey")
