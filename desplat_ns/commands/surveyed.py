"""What `desplat-survey` does once its options are checked; importing it takes seconds."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, cast

from nerfstudio.data.dataparsers.base_dataparser import DataParserConfig

from desplat_ns.console import announce
from desplat_ns.data.images import write_image
from desplat_ns.datamanager import without_prompts
from desplat_ns.errors import BackendUnavailableError
from desplat_ns.files.whole import draft_of, plain_errors, write_whole
from desplat_ns.layouts.dataparser import DeSplatDataParserConfig
from desplat_ns.model import DeSplatModelConfig
from desplat_ns.settings.effects import Effects
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Capture, capture_of
from desplat_ns.survey.picture import evidence_picture
from desplat_ns.survey.survey import effects_of, survey


def survey_capture(
    data: Path,
    output: Path,
    measure_costs: bool = True,
    dataparser: DataParserConfig | None = None,
    verbose: bool = False,
) -> Survey:
    """Say which effects a capture calls for, and write it down.

    Args:
        data: folder of the capture.
        output: folder for survey.json and survey.png.
        measure_costs: whether to time training steps with and without what is called for.
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
    record = json.loads(findings.to_json())
    _write(record, output)
    with plain_errors(output), draft_of(output / "survey.png") as draft:
        write_image(draft, evidence_picture(evidence))
    if measure_costs:
        try:
            _write(record | {"on_this_machine": costs_on_this_machine(findings, capture)}, output)
        except BackendUnavailableError as reason:
            announce(f"What steps cost here is not measured. {reason}", warning=True)
    announce(f"Saved {output / 'survey.json'} and {output / 'survey.png'}.")
    return findings


def _write(record: dict[str, Any], output: Path) -> None:
    """Write survey.json. Raises ConfigError where that cannot be done."""
    with plain_errors(output):
        write_whole(output / "survey.json", (json.dumps(record, indent=2) + "\n").encode())


def costs_on_this_machine(findings: Survey, capture: Capture) -> dict[str, Any]:
    """Time steps with each effect that is called for, and with all of them; say so.

    Returns:
        The size of the step, as JSON, and each case with its effects.
    """
    from desplat_ns.calibration.effects_cost import StepSize, measure  # takes seconds
    from desplat_ns.method_configs import desplat

    model = cast(DeSplatModelConfig, desplat.config.pipeline.model)
    width, height = (int(side.median()) for side in (capture.cameras.width, capture.cameras.height))
    num_photos = len(capture.photos)
    size = StepSize.for_photos(width, height, num_photos, model.gaussians_per_pixel)
    nothing, every = Effects(distractors=False), effects_of(findings)
    alone = [replace(nothing, **{name: value}) for name, value in every.on.items()]
    costs = measure(size, [*alone, every], num_photos)
    announce(
        f"On this machine, at {size.width} x {size.height} pixels and {size.num_gaussians} "
        f"Gaussians, a step takes {'; '.join(cost.words() for cost in costs)}."
    )
    return {"size": asdict(size), "steps": [asdict(cost) for cost in costs]}


def _outputs(data: Path, dataparser: DataParserConfig | None):
    dataparser = dataparser or DeSplatDataParserConfig()
    dataparser.data = data  # pyright: ignore[reportAttributeAccessIssue]
    return without_prompts(dataparser).setup().get_dataparser_outputs("train")
