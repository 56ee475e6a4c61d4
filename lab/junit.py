"""What pytest's JUnit file says."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path
from typing import Any

from lab.gpu.records import without_places

MOST_LISTED = 30
"""Failures and reasons that are kept."""


def read_results(path: Path) -> dict[str, Any]:
    """Numbers of tests by how they ended, and what was said of those that did not pass."""
    counts: Counter[str] = Counter()
    bad: list[str] = []
    reasons: Counter[str] = Counter()
    for case in ElementTree.parse(path).getroot().iter("testcase"):
        kind, said = _outcome(case)
        counts[kind] += 1
        name = f"{case.get('classname', '')}.{case.get('name', '')}".strip(".")
        if kind in ("failed", "error"):
            bad.append(f"{name}: {said}")
        elif kind == "skipped":
            reasons[said] += 1
    return {
        **{kind: counts[kind] for kind in ("passed", "failed", "error", "skipped")},
        "bad": bad[:MOST_LISTED],
        "reasons": dict(reasons.most_common(MOST_LISTED)),
    }


def _outcome(case: ElementTree.Element) -> tuple[str, str]:
    for tag, kind in (("failure", "failed"), ("error", "error"), ("skipped", "skipped")):
        element = case.find(tag)
        if element is not None:
            said = without_places(element.get("message") or "").strip().splitlines()
            return kind, said[0][:300] if said else ""
    return "passed", ""
