"""What is said on the console."""

from __future__ import annotations

from rich.progress import Progress

from desplat_ns.console import progress_over


def test_progress_counts_what_is_done(monkeypatch):
    advanced = []
    monkeypatch.setattr(Progress, "advance", lambda self, task: advanced.append(task))
    with progress_over(2, "Testing") as advance:
        advance()
        advance()
    assert len(advanced) == 2
