"""Survey generated scenes and the real ones, and print how often the decisions are right.

python -m lab.survey            (15 minutes the first time: scenes are generated and kept)

The record is outputs/survey/survey.json.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Capture
from desplat_ns.survey.survey import survey
from lab.documents import OUTPUTS
from lab.survey import unfamiliar
from lab.survey.real import Allowed, available
from lab.survey.report import report
from lab.survey.scenes import EVALUATION, SETTING, GeneratedScene

SCENES = OUTPUTS / "survey"


def measure(capture: Capture) -> tuple[Survey, dict[str, Any]]:
    """The survey, and its decisions, figures and CPU seconds."""
    start = time.process_time()
    findings, _ = survey(capture)
    seconds = time.process_time() - start
    figures = [figure for finding in findings.findings for figure in finding.figures]
    return findings, {
        "decisions": findings.decisions(),
        "confidence": {finding.effect: finding.confidence for finding in findings.findings},
        "figures": {f.name: round(f.value, 5) if f.is_known else None for f in figures},
        "cpu_seconds": round(seconds, 2),
        "photos": findings.num_surveyed,
    }


def measure_generated(scene: GeneratedScene, folder: Path) -> dict[str, Any]:
    """The record of one generated scene."""
    findings, record = measure(scene.make(folder))
    truth = {effect: getattr(scene.truth, effect) for effect in findings.decisions()}
    wrong = [effect for effect, value in findings.decisions().items() if truth[effect] != value]
    return {"name": scene.name, "truth": truth, "wrong": wrong, **record}


def measure_known(capture: Capture, right: Allowed) -> dict[str, Any]:
    """The record of a capture of which some decisions are known to be right."""
    findings, record = measure(capture)
    decisions = findings.decisions()
    wrong = [effect for effect, allowed in right.items() if decisions[effect] not in allowed]
    return {"wrong": wrong, **record}


def main() -> None:
    """Survey what is there, write the record, and print the tables."""
    kinds = ("setting", "evaluation", "faint", "real", "unfamiliar")
    records: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
    for scene in (*SETTING, *EVALUATION):
        kind = "setting" if scene in SETTING else "evaluation"
        kind = kind if scene.strengths.is_visible else "faint"
        records[kind].append(measure_generated(scene, SCENES))
    for real, root in available():
        record = measure_known(real.open(root), real.right)
        records["real"].append({"name": real.name, "seen": real.content, **record})
    for name, capture in unfamiliar.available(SCENES):
        record = measure_known(capture, unfamiliar.right_of(name))
        chosen_on = unfamiliar.was_chosen_on(name)
        records["unfamiliar"].append({"name": name, "chosen_on": chosen_on, **record})
    (SCENES / "survey.json").write_text(json.dumps(records, indent=1) + "\n", "utf8")
    print(report(records))


if __name__ == "__main__":
    main()
