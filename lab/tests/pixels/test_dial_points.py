from __future__ import annotations

import json
from dataclasses import asdict

from lab.pixels.dial_points import (
    DialPoint,
    DialStudy,
    Label,
    LeftOut,
    front_of,
    marked,
)


def point(group: str, forward: float, picture: float, both: float, gradient: float) -> DialPoint:
    return DialPoint(
        group,
        "dial",
        "value",
        "numba",
        is_default=False,
        clock="CPU",
        forward_ms=forward,
        both_ms=both,
        forward_range_ms=(forward, forward),
        both_range_ms=(both, both),
        calls=1,
        picture_error=picture,
        picture_psnr=40.0,
        gradient_error=gradient,
        worst_gradient="means",
    )


POINTS = [
    point("a", 1.0, 0.3, 2.0, 0.3),
    point("a", 2.0, 0.1, 3.0, 0.4),  # a better picture; gradients dearer and worse
    point("a", 3.0, 0.2, 1.0, 0.5),  # the reverse, of the cheapest gradients
    point("b", 9.0, 0.9, 9.0, 0.9),  # alone in its group
]


def test_pictures_and_gradients_have_fronts_of_their_own_in_each_group():
    fronts = front_of(POINTS)
    assert fronts.picture == {0, 1, 3}
    assert fronts.gradient == {0, 2, 3}


def test_points_are_marked_with_what_is_as_exact_and_cheaper():
    points = marked(POINTS)
    assert [p.is_on_picture_front for p in points] == [True, True, False, True]
    assert [p.is_on_gradient_front for p in points] == [True, False, True, True]
    assert [p.forward_excess for p in points] == [1, 1, 1.5, 1]
    assert [p.both_excess for p in points] == [1, 1.5, 1, 1]


def test_a_study_becomes_json():
    left_out = LeftOut("a", "dial", "other", "torch", reason="no time")
    text = json.dumps(asdict(DialStudy("scene", 1.0, POINTS, [left_out])))
    assert json.loads(text)["points"][1]["picture_error"] == 0.1
    assert json.loads(text)["left_out"][0]["reason"] == "no time"


def test_a_label_reads_as_a_line():
    assert str(Label("a", "alpha cutoff", "1/64", "numba")) == "a: numba, alpha cutoff 1/64"
