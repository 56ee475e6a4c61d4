"""What the survey says: a decision for each effect, and why."""

import json
import math
from dataclasses import asdict, dataclass
from typing import Literal

Confidence = Literal["clear", "close", "none"]

CLEAR = 1.5
"""A figure that is so many times its threshold, or that part of it, is clear of it."""


@dataclass(frozen=True)
class Finding:
    """What was seen of one effect, and what follows."""

    effect: Literal["appearance", "background"]
    decision: str
    """The value of the effect's switch that explains what was seen at the least cost."""
    confidence: Confidence
    """`clear`: the deciding figures are off by a factor of `CLEAR`; `close`: by less; `none`:
    safe."""
    reason: str
    """A sentence with the figures that decided."""
    figures: dict[str, float]
    """What was measured, NaN where it could not be; docs/explain/survey.md says what each is."""

    def line(self) -> str:
        sure = {"clear": "", "close": " (a close call)", "none": " (the safe side)"}
        return f"{self.effect}: {self.decision}{sure[self.confidence]}. {self.reason}"


@dataclass(frozen=True)
class Survey:
    """What a capture calls for."""

    appearance: Finding
    background: Finding
    num_photos: int
    """Of the training split."""
    notes: tuple[str, ...] = ()
    mismatch: str = ""
    """What makes training useless: see `mismatches`."""

    @property
    def findings(self) -> tuple[Finding, Finding]:
        return self.appearance, self.background

    def decisions(self) -> dict[str, str]:
        return {finding.effect: finding.decision for finding in self.findings}

    def to_json(self) -> str:
        """Everything, as JSON; numbers that could not be measured are null."""
        plain = json.loads(
            json.dumps(asdict(self)),
            parse_float=lambda text: round(float(text), 6),
            parse_constant=lambda _: None,
        )
        return json.dumps(plain, indent=2) + "\n"

    def summary(self) -> list[str]:
        """Lines for a console: notes, and one for each effect."""
        return [*self.notes, *(finding.line() for finding in self.findings)]


def confidence_of(*figures: tuple[float, float]) -> Confidence:
    """How far the figures that decided are from their thresholds; the nearest one counts."""
    if all(math.isnan(value) for value, _ in figures):
        return "none"
    is_close = any(limit / CLEAR < value < limit * CLEAR for value, limit in figures)
    return "close" if is_close else "clear"
