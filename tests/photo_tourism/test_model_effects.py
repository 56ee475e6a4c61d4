"""The model with per-image effects: what is drawn, trained, saved and exported."""

import pytest
import torch

from desplat_ns.distractors.config import DistractorConfig
from desplat_ns.evaluation.config import EvaluationConfig
from desplat_ns.evaluation.halves import embedding_from_left_half
from desplat_ns.model import DeSplatModel
from desplat_ns.photo_tourism.camera_response import CENTRED, camera_response, squared_radius
from desplat_ns.photo_tourism.image_effects import FEATURES
from tests.helpers.small_model import HEIGHT, WIDTH, Trainer, camera, held_out, model_with, moved


def draw(model: DeSplatModel, view: int | None, where: int = 0) -> torch.Tensor:
    """Training view `where`'s pose, drawn as view `view`."""
    pose = camera(where)
    pose.metadata = {} if view is None else {"train_idx": torch.tensor([[view]])}
    return model.get_outputs_for_camera(pose)["rgb"]


@pytest.mark.parametrize(("appearance", "sh_degree"), [("camera", 3), ("affine", 0), ("sh", 3)])
def test_the_start_looks_as_without_then_each_image_has_its_light_and_the_average_another(
    appearance, sh_degree
):
    plain = model_with(sh_degree=sh_degree).eval()
    model = model_with(appearance, sh_degree=sh_degree).eval()
    torch.testing.assert_close(draw(model, 1), draw(plain, 1), rtol=0, atol=1e-5)
    moved(model)
    images = [draw(model, view) for view in (0, 1, None)]
    for i in range(3):
        assert (images[i] - images[i - 1]).abs().max() > 1e-3


@pytest.mark.parametrize(("grade", "scale"), [("sh", 1.0), ("image", 0.1)])
def test_a_background_has_one_colour_until_nominal_step_500(grade, scale):
    """Then the linear harmonics come in."""
    model = moved(model_with("off", background=grade, schedule_scale=scale)).eval()
    first, view = round(500 * scale), model.view_of_camera(camera(0), None)
    images = {}
    for step in (first - 1, first):
        model.step = step
        images[step] = model.get_outputs_for_camera(camera(0))["background"]
    assert (images[first - 1] == images[first - 1][0, 0]).all()
    linear = model.image_effects.background_of(model.image_effects.of(0), view, degree=1)
    assert torch.equal(images[first], linear)
    assert (linear - linear[0, 0]).abs().max() > 0.01
    model.step = first - 1
    assert torch.equal(draw(model, 0), draw(model, None)) == (grade == "sh")  # one for all images
    outputs = model.get_outputs_for_camera(camera(0))
    empty = outputs["accumulation"][..., 0] == 0
    assert empty.any()
    assert torch.equal(outputs["rgb"][empty], outputs["background"][empty])


@pytest.mark.parametrize(
    ("appearance", "background"), [("affine", "image"), ("sh", "image"), ("camera", "sh")]
)
def test_a_step_trains_every_group_but_other_images_embeddings(appearance, background):
    model = moved(model_with(appearance, background))
    trainer = Trainer(model)
    before = {n: p.detach().clone() for n, p in model.named_parameters()}
    losses = trainer.step(4000, view=1)["losses"]  # all degrees are active
    assert "background_opacity" in losses
    effects = model.image_effects
    own = effects.responses if appearance == "camera" else effects.embeddings
    assert own is not None and own.grad is not None
    assert (own.grad[1] != 0).any() and (own.grad[[0, 2]] == 0).all()
    for name, parameter in model.named_parameters():
        if "image_effects" in name or FEATURES in name:
            assert not torch.equal(parameter, before[name]), name


def test_features_follow_clones_splits_and_prunes():
    """Each Gaussian's own number stands in its colour and in its features, and stays in both."""
    model = model_with("affine", warmup_length=0, refine_every=2, densify_grad_thresh=1e-9)
    trainer = Trainer(model)
    own = torch.arange(model.num_points, dtype=torch.float32)
    for name in ("features_dc", FEATURES):
        model.gauss_params[name].data[:, 0] = own / len(own)
        trainer.optimizers[name].param_groups[0]["lr"] = 0.0
    for step in range(9):
        if step == 5:
            model.gauss_params["opacities"].data[::3] = -20.0  # to be pruned
        trainer.step(step, view=step % 3)
    colors, features = model.gauss_params["features_dc"], model.gauss_params[FEATURES]
    assert len(features) == model.num_points > len(own)
    assert len(colors[:, 0].unique()) < len(own)
    assert torch.equal(features[:, 0], colors[:, 0])
    state = trainer.optimizers[FEATURES].state[features]
    assert len(state["exp_avg"]) == model.num_points


def test_a_checkpoint_brings_everything_back():
    model = moved(model_with("affine", background="image"))
    model.gauss_params[FEATURES].data.normal_()
    other = model_with("affine", background="image")
    other.load_state_dict(model.state_dict())
    assert torch.equal(draw(other.eval(), 1), draw(model.eval(), 1))


def test_what_a_mask_leaves_out_is_no_sky():
    model = model_with("affine", background="image")
    Trainer(model).step(0)
    outputs = model(camera(0))
    photo = outputs["background"].detach().expand(HEIGHT, WIDTH, 3).clone()  # explained everywhere
    left = torch.zeros(HEIGHT, WIDTH, 1, dtype=torch.bool)
    left[:, : WIDTH // 3] = True

    def loss(**mask: torch.Tensor) -> torch.Tensor:
        return model.get_loss_dict(outputs, {"image": photo, **mask})["background_opacity"]

    assert loss(mask=left) > 0
    assert loss(mask=~left) > 0
    # Of all pixels but those in the corners, two on each side.
    columns = WIDTH // 3, WIDTH - WIDTH // 3
    inside, outside = (HEIGHT * number - 2 for number in columns)
    together = (inside * loss(mask=left) + outside * loss(mask=~left)) / (inside + outside)
    torch.testing.assert_close(together, loss(), rtol=1e-5, atol=0)
    assert loss(mask=torch.zeros_like(left)) == 0


@pytest.mark.slow
def test_training_finds_the_cameras_responses_and_leaves_the_scene_its_colours():
    model = model_with("camera", distractors=DistractorConfig(per_view=0))
    lights = torch.tensor([[0.3, 0.2, 0.1, 0, 0], [0, 0, 0, 0.2, 0], [-0.3, -0.2, -0.1, -0.2, 0]])
    photos = []
    for view, light in enumerate(lights):
        plain = model.eval().get_outputs_for_camera(camera(view))["rgb"]
        radius2 = squared_radius(model.view_of_camera(camera(view), None))
        photos.append(camera_response(plain, light, radius2).clamp(0, 1))
    trainer = Trainer(model)
    model.strategy.refine_stop_iter = 0
    group = model.get_param_groups()["camera_responses"]
    trainer.optimizers = {"camera_responses": torch.optim.Adam(group, lr=0.02)}
    for step in range(150):
        trainer.photo = photos[step % 3]
        trainer.step(step, view=step % 3)
    responses = model.image_effects.responses.detach()
    torch.testing.assert_close(responses[:, :3], lights[:, :3], atol=0.06, rtol=0)
    assert model.image_effects.of(None)[:CENTRED].abs().max() < 1e-5
    assert not torch.equal(draw(model.eval(), 0), draw(model, 2))


def test_distractors_keep_their_own_colours_before_a_toned_scene():
    model = model_with("camera").eval()
    before = model.get_outputs_for_camera(camera(1))
    model.image_effects.responses.data[1, :3] = 0.5
    after = model.get_outputs_for_camera(camera(1))
    assert torch.equal(before["rgb_distractor"], after["rgb_distractor"])
    alpha, layer = after["alpha_distractor"], after["rgb_distractor"]
    unclipped = (after["rgb_static"] < 1).all(dim=-1)
    expected = layer + (1 - alpha) * after["rgb_static"]
    torch.testing.assert_close(after["rgb_composite"][unclipped], expected.clamp(0, 1)[unclipped])
    assert (after["rgb_static"] - before["rgb_static"]).max() > 0.05


def test_the_light_of_a_test_photo_is_found_on_its_left_half_at_once():
    model = model_with("camera").eval()
    light = torch.tensor([0.3, 0.1, -0.1, 0.15, 0.0])
    plain = model.get_outputs_for_camera(held_out())["rgb"]
    radius2 = squared_radius(model.view_of_camera(held_out(), None))
    photo = camera_response(plain, light, radius2).clamp(0, 1)
    photo[:, WIDTH // 2 :] = 0.5  # what the right half shows has no say
    embedding = embedding_from_left_half(model, held_out(), photo, EvaluationConfig(steps=0))
    with model.shown_light.fixed(embedding):
        again = model.get_outputs_for_camera(held_out())["rgb"]
    left = photo.shape[1] // 2
    torch.testing.assert_close(again[:, :left], photo[:, :left], atol=2e-3, rtol=0)


def test_transparent_pixels_of_a_training_photo_do_not_pull_at_its_light():
    model = model_with("camera", distractors=DistractorConfig(per_view=0))
    model.image_effects.responses.data[0, :3] = 0.3
    trainer = Trainer(model)
    trainer.photo = torch.zeros(HEIGHT, WIDTH, 4)
    losses = []
    for color in ("white", "black"):
        model.config.background_color = color
        model.gauss_params["opacities"].data.fill_(-20.0)  # nothing is in sight
        losses.append(trainer.step(0)["losses"]["main_loss"])
    for loss in losses:
        assert loss < 1e-3
