"""A capture that is painted, small: its files fit together, and every part of a run takes it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desplat_ns.data.colmap import DeSplatColmapDataParserConfig
from desplat_ns.data.images import read_image
from desplat_ns.data.tracks import METADATA_KEY
from lab.performance.large_captures import measure
from lab.synthetic.many_photos import ManyPhotos, write_many_photos

SPEC = ManyPhotos(photos=12, width=96, height=72, points=6000)


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    write_many_photos(SPEC, folder)
    return folder


def test_photos_show_the_points_that_they_observe(capture: Path):
    """A pixel's colour is nearer to its point's than to another's, drawn at random: more often than
    in the mirror, by five standard deviations of such a difference."""
    parser = DeSplatColmapDataParserConfig(data=capture, eval_mode="all").setup()
    outputs = parser.get_dataparser_outputs("train")
    assert len(outputs.image_filenames) == SPEC.photos
    assert len(outputs.metadata["points3D_rgb"]) == SPEC.points
    rgb, rng = outputs.metadata["points3D_rgb"].numpy().astype(int), np.random.default_rng(0)
    nearer: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for path, observed in zip(
        outputs.image_filenames, outputs.metadata[METADATA_KEY].read(range(12)), strict=True
    ):
        x, y = (observed.places * (96, 72)).astype(int).T
        for is_mirrored in (False, True):
            shown = read_image(path)[:, :: -1 if is_mirrored else 1][y, x].astype(int)
            own, others = rgb[observed.points], rgb[rng.permutation(observed.points)]
            off, chance = (np.abs(shown - colors).sum(axis=1) for colors in (own, others))
            nearer[is_mirrored].append(off < chance)
    count = sum(map(len, nearer[False]))
    deviation = 0.5 * np.sqrt(2 / count)
    shares = {key: np.concatenate(parts).mean() for key, parts in nearer.items()}
    assert shares[False] > shares[True] + 5 * deviation


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_what_a_capture_costs_is_measured(capture: Path):
    options = ["--pipeline.datamanager.photo-memory", "1e-4", "colmap"]
    survey, training, report = (
        measure(capture, part, 3, options) for part in ("survey", "training", "report")
    )
    assert survey["survey"] > 0 and report["report"] > 0
    assert training["until_set_up"] < training["until_first_step_done"]
    assert all(cost["peak_gigabytes"] > 0.1 for cost in (survey, training, report))
