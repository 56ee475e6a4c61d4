from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from desplat_ns.data.exif import exposure_in_stops


def photo(path: Path, **tags: float) -> Path:
    spec = oiio.ImageSpec(8, 6, 3, oiio.UINT8)
    for name, value in tags.items():
        spec.attribute(name.replace("_", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file is not None and file.open(str(path), spec)
    file.write_image(np.zeros((6, 8, 3), np.uint8))
    file.close()
    return path


def test_twice_the_time_is_a_stop(tmp_path):
    one = photo(tmp_path / "a.jpg", ExposureTime=0.01, FNumber=2.0, Exif_ISOSpeedRatings=100)
    two = photo(tmp_path / "b.jpg", ExposureTime=0.02, FNumber=2.0, Exif_ISOSpeedRatings=100)
    first, second = exposure_in_stops(one), exposure_in_stops(two)
    assert first is not None and second is not None
    assert second - first == pytest.approx(1.0, abs=0.01)


def test_what_is_missing_or_broken_is_none(tmp_path):
    assert exposure_in_stops(photo(tmp_path / "a.jpg")) is None
    assert exposure_in_stops(photo(tmp_path / "b.jpg", ExposureTime=0.0, FNumber=2.0)) is None
    broken = tmp_path / "c.jpg"
    broken.write_bytes(b"no picture")
    assert exposure_in_stops(broken) is None
    assert exposure_in_stops(tmp_path / "none.jpg") is None
