"""Whose appearance is worn: an evaluation's, the viewer's, the environment's, its own, the mean."""

import pytest
import torch

from desplat_ns.errors import ConfigError
from desplat_ns.photo_tourism.embeddings import ImageEmbeddings
from desplat_ns.photo_tourism.shown_light import VARIABLE, WornAppearance, parse_worn

NAMES = ["a.jpg", "b:1.jpg", "c.jpg"]


@pytest.fixture
def embeddings() -> ImageEmbeddings:
    torch.manual_seed(0)
    return ImageEmbeddings(3, 4)


def test_an_image_of_its_own_else_the_average(embeddings):
    worn = WornAppearance(NAMES)
    assert torch.equal(worn.embedding(embeddings, 1), embeddings.weight[1])
    torch.testing.assert_close(worn.embedding(embeddings), embeddings.weight.mean(dim=0))


def test_the_viewer_mixes_two_images(embeddings):
    worn = WornAppearance(NAMES)
    worn.first.value, worn.second.value, worn.share.value = "a.jpg", "c.jpg", 0.25
    expected = 0.75 * embeddings.weight[0] + 0.25 * embeddings.weight[2]
    torch.testing.assert_close(worn.embedding(embeddings, 1), expected)


def test_one_choice_counts_whatever_the_slider_says(embeddings):
    worn = WornAppearance(NAMES)
    worn.first.value, worn.share.value = "c.jpg", 1.0
    torch.testing.assert_close(worn.embedding(embeddings), embeddings.weight[2])


def test_the_environment_names_a_mix(embeddings, monkeypatch):
    monkeypatch.setenv(VARIABLE, "a.jpg:3, c.jpg:1")
    worn = WornAppearance(NAMES)
    expected = 0.75 * embeddings.weight[0] + 0.25 * embeddings.weight[2]
    torch.testing.assert_close(worn.embedding(embeddings), expected)
    worn.first.value = "c.jpg"  # the viewer comes before it
    torch.testing.assert_close(worn.embedding(embeddings), embeddings.weight[2])


def test_an_evaluation_sees_neither(embeddings, monkeypatch):
    monkeypatch.setenv(VARIABLE, "a.jpg")
    worn = WornAppearance(NAMES)
    with worn.suspended():
        torch.testing.assert_close(worn.embedding(embeddings), embeddings.weight.mean(dim=0))
        with worn.fixed(torch.ones(4)):
            assert torch.equal(worn.embedding(embeddings), torch.ones(4))
    torch.testing.assert_close(worn.embedding(embeddings), embeddings.weight[0])


def test_a_name_of_another_scene_matters_only_where_it_is_worn(embeddings, monkeypatch):
    monkeypatch.setenv(VARIABLE, "elsewhere.jpg")
    worn = WornAppearance(NAMES)
    with worn.suspended():
        worn.embedding(embeddings)
    with pytest.raises(ConfigError, match=r"elsewhere\.jpg"):
        worn.embedding(embeddings)


def test_names_may_hold_colons():
    assert parse_worn("b:1.jpg", NAMES) == [(1, 1.0)]
    assert parse_worn("b:1.jpg:2,a.jpg:2", NAMES) == [(1, 0.5), (0, 0.5)]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x.jpg", "'x.jpg'.*no training image"),
        ("a.jpg:much", "'much'.*no number"),
        ("a.jpg:0", "all zero"),
        ("a.jpg:-1,c.jpg:2", "negative"),
        (",", "all zero"),
    ],
)
def test_a_text_that_makes_no_mix_is_refused(text, message):
    with pytest.raises(ConfigError, match=message):
        parse_worn(text, NAMES)


def test_all_images_can_share_one_embedding():
    shared = ImageEmbeddings(1, 4)
    assert torch.equal(shared.of(7), shared.of(0))
    assert torch.equal(shared.mean(), shared.of(0))
