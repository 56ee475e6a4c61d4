"""How photos are called."""

from pathlib import Path

from desplat_ns.data.training_views import image_names


def test_names_are_relative_to_the_folder_that_all_photos_share():
    paths = [Path("/c/images/left/1.png"), Path("/c/images/right/1.png")]
    assert image_names(paths) == ["left/1.png", "right/1.png"]
    assert image_names([Path("/c/images/1.png")]) == ["1.png"]
    assert image_names([]) == []
