from __future__ import annotations

from dataclasses import fields, replace

import pytest

from desplat_ns.errors import ConfigError
from lab.synthetic.daylight import DaylightSpec
from lab.synthetic.spec import SceneSpec


@pytest.mark.parametrize(
    "change",
    [
        {"num_views": 2},
        {"num_extras": 0},
        {"width": 8},
        {"supersample": 0},
        {"other_sizes": ((48, 64), (64, 8))},
        {"layout": "llff"},
        {"place": "attic"},
    ],
)
def test_scenes_that_cannot_be_drawn_are_an_error_that_names_the_field(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        SceneSpec(**change)


def test_what_is_off_leaves_no_trace_in_the_record():
    record = SceneSpec().to_dict()
    assert set(record) == {f.name for f in fields(SceneSpec)} - {
        "daylight",
        "other_sizes",
        "layout",
        "place",
    }
    assert set(record["occluders"]) == {"kinds", "min_fraction", "max_fraction"}
    lit = replace(SceneSpec(), daylight=DaylightSpec()).to_dict()
    assert set(lit) - set(record) == {"daylight"}
    tourism = SceneSpec.tourism().to_dict()
    assert set(tourism) == {f.name for f in fields(SceneSpec)} - {"place"}
    room = SceneSpec.bare_room(15).to_dict()
    assert room["place"] == "room"
    assert (room["occluders"]["faint"], room["occluders"]["lingering"]) == (0.25, 0.2)


def test_new_places_have_specs_of_their_own():
    assert SceneSpec.facade(8).to_dict()["place"] == "facade"
    assert SceneSpec.table_top(20).to_dict()["place"] == "table"


def test_each_purpose_has_random_numbers_of_its_own():
    spec = SceneSpec(seed=3)
    assert spec.rng(2, 1).random() == spec.rng(2, 1).random()
    numbers = {spec.rng(*purpose).random() for purpose in [(0,), (1,), (2, 0), (2, 1)]}
    numbers.add(SceneSpec(seed=4).rng(0).random())
    assert len(numbers) == 5


def test_a_daylight_without_a_sun_of_its_own_is_recorded_as_before():
    record = replace(SceneSpec(), daylight=DaylightSpec()).to_dict()["daylight"]
    assert set(record) == {"kinds", "strength", "sky"}
    sunny = replace(SceneSpec(), daylight=DaylightSpec(sun=30.0)).to_dict()["daylight"]
    assert sunny["sun"] == 30.0
