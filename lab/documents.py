"""Where the records and documents of this repository lie: only a checkout has them."""

from __future__ import annotations

from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
DOCS = CHECKOUT / "docs"
RESULTS, DEV, RESEARCH = DOCS / "results", DOCS / "dev", DOCS / "research"
RECORDS = DOCS / "records"
"""What was measured, as JSON; pages are written from it."""

OUTPUTS = CHECKOUT / "outputs"
"""What studies train, a folder each; git ignores it."""
