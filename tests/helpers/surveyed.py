"""Captures with some of their photos, or with copies to be damaged, and what a survey finds."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import torch

from desplat_ns.survey.findings import Survey
from desplat_ns.survey.observations import Capture
from desplat_ns.survey.survey import survey as survey_with_evidence


def survey(capture: Capture) -> Survey:
    """The findings alone."""
    return survey_with_evidence(capture)[0]


def copied(capture: Capture, folder: Path) -> Capture:
    """The same capture with photos of its own, to be damaged."""
    photos = [Path(shutil.copy(path, folder / path.name)) for path in capture.photos]
    return replace(capture, photos=photos)


def some(capture: Capture, which: list[int]) -> Capture:
    """Some of the photos."""
    tracks = capture.tracks
    assert tracks is not None
    return replace(
        capture,
        cameras=capture.cameras[torch.tensor(which, dtype=torch.long)],
        photos=[capture.photos[i] for i in which],
        tracks=replace(tracks, image_ids=tuple(tracks.image_ids[i] for i in which)),
    )
