import numpy as np
import pytest

from lab.separation import family
from lab.separation.passers_by import Frame, ghost, truth_of

COLORS = np.random.default_rng(0).random((2, 50, 3))
TRUTH, PHOTO = COLORS


@pytest.mark.parametrize("left", [0.0, 0.3, 1.0])
def test_the_ghost_is_the_share_of_the_passer_by_that_is_left(left):
    static = (1 - left) * TRUTH + left * PHOTO
    assert ghost(static, TRUTH, PHOTO) == pytest.approx(left, abs=1e-12)


def test_polygons_become_masks_of_the_size_asked_for():
    for name, polygons in family.FRAMES.items():
        passers, unsure = family.masks(f"{name}.jpg", 427, 237), family.unsure(name, 427, 237)
        still = family.still(name, 427, 237)
        assert passers.shape == unsure.shape == (237, 427)
        kinds = {kind for kind, _ in polygons}
        assert kinds <= {*family.PASSING, *family.STILL, family.UNSURE}
        assert passers.any() == bool(kinds & {*family.PASSING})
        assert not (passers & unsure).any()
        assert still["statue"].any()
        assert not any((mask & (passers | unsure)).any() for mask in still.values())


def _wall(name: str, shift: float) -> Frame:
    """A wall two units before a camera that stands so many units to the right; columns differ."""
    width, height, focal = 122, 68, 50.0
    columns = np.arange(width) + shift * focal / 2
    photo = np.repeat((0.2 + 0.004 * columns)[None, :, None], height, 0).repeat(3, 2)
    pose = np.eye(4)
    pose[0, 3] = -shift
    intrinsics = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    nothing = np.zeros((height, width), bool)
    depth = np.full((height, width), 2, np.float32)
    return Frame(name, photo.astype(np.float32), photo, depth, nothing, intrinsics, pose)


def test_behind_a_passer_by_is_what_the_others_show_in_this_photos_exposure():
    photo = _wall("015", 0.0)
    others = [_wall("007", 0.2), _wall("008", -0.2)]
    darker = [Frame(**{**vars(other), "photo": 0.5 * other.photo}) for other in others]
    truth = truth_of(photo, [photo, *darker])
    assert photo.passers.any()
    assert truth[photo.passers] == pytest.approx(photo.photo[photo.passers], abs=1e-3)
