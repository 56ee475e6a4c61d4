"""Where the records and documents of this repository lie: only a checkout has them."""

from __future__ import annotations

from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1]
DOCS = CHECKOUT / "docs"
RESULTS = DOCS / "results"
RECORDS = DOCS / "records"
"""What was measured, a line of JSON for each run."""

OUTPUTS = CHECKOUT / "outputs"
"""What studies train, a folder each; git ignores it."""
