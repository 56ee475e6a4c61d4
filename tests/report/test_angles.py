"""What is said of how far photos are from one another."""

from desplat_ns.report.angles import Angles, in_words
from tests.helpers.report import held_out_photo


def test_the_farthest_photos_are_named_and_what_is_usual_is_said():
    held_out = {"near.png": 4.0, "middle.png": 8.4, "far.png": 33.0}
    training = {f"{number}.png": 2.0 * number for number in range(5)}
    said = in_words(Angles(held_out, training))
    assert "8° in the middle of the held-out photos" in said
    assert "most in far.png (33°), middle.png (8°), near.png (4°)." in said
    assert said.endswith("few photos: 4.png (8°), 3.png (6°), 2.png (4°).")


def test_nothing_is_said_where_nothing_was_measured():
    assert in_words(Angles({}, {})) == ""


def test_a_photos_angle_is_one_of_its_figures():
    angles = Angles({"near.png": 4.0}, {})
    assert angles.added_to(held_out_photo("near.png")).figures["angle"] == 4.0
    assert "angle" not in angles.added_to(held_out_photo("other.png")).figures
