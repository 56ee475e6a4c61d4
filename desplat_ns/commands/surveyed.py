"""What `desplat-survey` does once its options are checked; importing it takes seconds."""

from __future__ import annotations

from pathlib import Path

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

from desplat_ns.console import announce
from desplat_ns.data.images import write_image
from desplat_ns.datamanager import without_prompts
from desplat_ns.files.whole import draft_of, plain_errors, write_whole
from desplat_ns.layouts.dataparser import DeSplatDataParserConfig
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import capture_of
from desplat_ns.survey.picture import evidence_picture
from desplat_ns.survey.survey import survey


def survey_capture(
    data: Path,
    output: Path,
    dataparser: DataParserConfig | None = None,
    verbose: bool = False,
) -> Survey:
    """Say which effects a capture calls for, and write it down.

    Args:
        data: folder of the capture.
        output: folder for survey.json and survey.png.
        dataparser: reads the capture; without it, the layout is recognised.
        verbose: whether to print every figure.

    Raises:
        CaptureError: the capture cannot be read or surveyed.
        ConfigError: nothing can be written to `output`.
    """
    capture = capture_of(_outputs(data, dataparser))
    findings, evidence = survey(capture)
    for line in findings.summary(verbose):
        announce(line)
    with plain_errors(output):
        write_whole(output / "survey.json", findings.to_json().encode())
    with plain_errors(output), draft_of(output / "survey.png") as draft:
        write_image(draft, evidence_picture(evidence))
    announce(f"Saved {output / 'survey.json'} and {output / 'survey.png'}.")
    return findings


def _outputs(data: Path, dataparser: DataParserConfig | None):
    dataparser = dataparser or DeSplatDataParserConfig()
    dataparser.data = data  # pyright: ignore[reportAttributeAccessIssue]
    return without_prompts(dataparser).setup().get_dataparser_outputs("train")
