"""Survey generated scenes and the real ones; write docs/survey.json and docs/survey.md.

python -m benchmarks.survey            (15 minutes the first time: scenes are generated and kept)
python -m benchmarks.survey --report   (the document only)
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.documents import OUTPUTS
from benchmarks.survey.real import available
from benchmarks.survey.report import FILE, write_report
from benchmarks.survey.scenes import EVALUATION, SETTING, GeneratedScene
from desplat_ns.survey.capture import Capture
from desplat_ns.survey.findings import Survey
from desplat_ns.survey.survey import survey

SCENES = OUTPUTS / "survey"


def measure(capture: Capture) -> tuple[Survey, dict[str, Any]]:
    """The survey, and its decisions, figures and CPU seconds."""
    start = time.process_time()
    found = survey(capture)
    seconds = time.process_time() - start
    figures = [figure for finding in found.findings for figure in finding.figures]
    return found, {
        "decisions": found.decisions(),
        "confidence": {finding.effect: finding.confidence for finding in found.findings},
        "figures": {f.name: round(f.value, 5) if f.is_known else None for f in figures},
        "cpu_seconds": round(seconds, 2),
        "photos": found.num_surveyed,
    }


def measure_generated(scene: GeneratedScene, folder: Path) -> dict[str, Any]:
    """The record of one generated scene."""
    found, record = measure(scene.make(folder))
    truth = vars(scene.truth)
    wrong = [effect for effect, value in found.decisions().items() if truth[effect] != value]
    grade = {"grade": scene.label, "is_visible": scene.strengths.is_visible}
    return {"name": scene.name, **grade, "truth": truth, "wrong": wrong, **record}


def main() -> None:
    """Measure what is there and write both files."""
    if "--report" not in sys.argv:
        records: dict[str, list[dict[str, Any]]] = {"setting": [], "evaluation": [], "real": []}
        for name, scenes in (("setting", SETTING), ("evaluation", EVALUATION)):
            for scene in scenes:
                records[name].append(measure_generated(scene, SCENES))
                print(records[name][-1]["name"], records[name][-1]["wrong"] or "right", flush=True)
        for real, root in available():
            found, record = measure(real.open(root))
            decisions = found.decisions()
            wrong = [
                effect for effect, right in real.right.items() if decisions[effect] not in right
            ]
            records["real"].append({"name": real.name, "seen": real.seen, "wrong": wrong, **record})
            print(real.name, wrong or "right", flush=True)
        FILE.write_text(json.dumps(records, indent=1) + "\n", "utf8")
    print(f"Wrote {write_report()}.")


if __name__ == "__main__":
    main()
