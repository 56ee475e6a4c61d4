"""What an error map shows, and a training photo's pictures."""

import pytest

from desplat_ns.report.pictures import ERROR_COLORS, ERROR_TOP, error_map, training_photos
from tests.helpers.report import flat


def test_equal_pictures_have_no_error_and_large_errors_the_brightest_colour():
    photo = flat((100, 100, 100))
    assert (error_map(photo, photo) == ERROR_COLORS[0]).all()
    assert (error_map(photo, flat((0, 0, 0))) == ERROR_COLORS[-1]).all()
    off = round(255 * ERROR_TOP / 2)
    colour = error_map(flat((0, 0, 0)), flat((off, off, off)))[0, 0]
    assert colour.tolist() == pytest.approx(ERROR_COLORS[2], abs=2)


def test_a_photo_of_a_run_without_distractors_stands_beside_the_scene_alone(tiny_run, tmp_path):
    config = tiny_run(tmp_path).pipeline
    config.model.effects.distractors = False
    pipeline = config.setup(device="cpu")
    pipeline.eval()
    (photo,) = training_photos(pipeline, [1])
    assert photo.static.shape == photo.photo.shape
    assert (photo.distractors, photo.mask, photo.covered, photo.unlike) == (None,) * 4
