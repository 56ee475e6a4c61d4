"""Survey generated scenes and the real ones; write docs/records/survey.json and
docs/results/survey.md.

python -m lab.survey            (15 minutes the first time: scenes are generated and kept)
python -m lab.survey --report   (the document only)
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Capture
from desplat_ns.survey.survey import survey
from lab.documents import OUTPUTS
from lab.survey import unfamiliar
from lab.survey.real import Allowed, available
from lab.survey.report import FILE, write_report
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
    truth = vars(scene.truth)
    wrong = [effect for effect, value in findings.decisions().items() if truth[effect] != value]
    grade = {"grade": scene.label, "is_visible": scene.strengths.is_visible}
    return {"name": scene.name, **grade, "truth": truth, "wrong": wrong, **record}


def measure_known(capture: Capture, right: Allowed) -> dict[str, Any]:
    """The record of a capture of which some decisions are known to be right."""
    findings, record = measure(capture)
    decisions = findings.decisions()
    wrong = [effect for effect, allowed in right.items() if decisions[effect] not in allowed]
    return {"wrong": wrong, **record}


def main() -> None:
    """Measure what is there and write both files."""
    if "--report" not in sys.argv:
        kinds = ("setting", "evaluation", "real", "unfamiliar")
        records: dict[str, list[dict[str, Any]]] = {kind: [] for kind in kinds}
        for name, scenes in (("setting", SETTING), ("evaluation", EVALUATION)):
            for scene in scenes:
                records[name].append(measure_generated(scene, SCENES))
                print(records[name][-1]["name"], records[name][-1]["wrong"] or "right", flush=True)
        for real, root in available():
            record = measure_known(real.open(root), real.right)
            records["real"].append({"name": real.name, "seen": real.content, **record})
            print(real.name, record["wrong"] or "right", flush=True)
        for name, is_cluttered, capture in unfamiliar.available(SCENES):
            record = measure_known(capture, unfamiliar.right_of(name, is_cluttered))
            chosen_on = unfamiliar.was_chosen_on(name)
            records["unfamiliar"].append({"name": name, "chosen_on": chosen_on, **record})
            print(name, record["wrong"] or "right", flush=True)
        FILE.write_text(json.dumps(records, indent=1) + "\n", "utf8")
    print(f"Wrote {write_report()}.")


if __name__ == "__main__":
    main()
