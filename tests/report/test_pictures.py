"""What an error map shows."""

import pytest

from desplat_ns.report.pictures import ERROR_COLORS, ERROR_TOP, error_map
from tests.helpers.report import flat


def test_equal_pictures_have_no_error_and_large_errors_the_brightest_colour():
    photo = flat((100, 100, 100))
    assert (error_map(photo, photo) == ERROR_COLORS[0]).all()
    assert (error_map(photo, flat((0, 0, 0))) == ERROR_COLORS[-1]).all()
    off = round(255 * ERROR_TOP / 2)
    colour = error_map(flat((0, 0, 0)), flat((off, off, off)))[0, 0]
    assert colour.tolist() == pytest.approx(ERROR_COLORS[2], abs=2)
