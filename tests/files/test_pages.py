"""What pages share: escaping, times in words, pictures that fit."""

from __future__ import annotations

from pathlib import Path

import jinja2
import numpy as np
import pytest

from desplat_ns.files.pages import data_address, digits, inline_svg, template, time_in_words


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.2, "0 s"),
        (45.4, "45 s"),
        (59.7, "1 min"),
        (125.0, "2 min 5 s"),
        (3600.0, "1 h"),
        (4830.0, "1 h 20 min"),
    ],
)
def test_times_are_said_in_at_most_two_units(seconds: float, words: str):
    assert time_in_words(seconds) == words


@pytest.mark.parametrize(
    ("value", "text"), [(None, "unknown"), (float("nan"), "unknown"), (0.12345, "0.123")]
)
def test_figures_have_three_digits(value: float | None, text: str):
    assert digits(value) == text


def test_a_template_escapes_and_refuses_what_it_is_not_given(tmp_path: Path):
    path = tmp_path / "page.jinja"
    path.write_text("{{ name }}, {{ 61.0|time }}, {{ name|loud }}")
    page = template(path, loud=str.upper)
    assert page.render(name="<b>") == "&lt;b&gt;, 1 min 1 s, &lt;B&gt;"
    with pytest.raises(jinja2.UndefinedError):
        page.render()


@pytest.mark.parametrize("kind", ["WEBP", "JPEG"])
def test_a_picture_stands_in_its_address(kind):
    address = data_address(np.zeros((3, 4, 3), np.uint8), 2, 80, kind)
    assert address.startswith(f"data:image/{kind.lower()};base64,")


def test_an_svg_file_becomes_a_part_of_the_page():
    text = '<?xml version="1.0"?>\n<svg width="3pt" height="4pt" viewBox="0 0 3 4" xmlns:a="b">'
    text += "<metadata>\nwho</metadata><g/></svg>"
    assert inline_svg(text) == '<svg viewBox="0 0 3 4"><g/></svg>'
