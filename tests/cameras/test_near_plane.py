"""What hangs before a camera is in no rendering, and training sees it."""

import pytest
import torch
from scipy.spatial.transform import Rotation

from desplat_ns.cameras.near_plane import scene_start, stands_clear
from desplat_ns.cameras.views import view_of
from desplat_ns.evaluation.halves import as_function_of_embedding
from desplat_ns.model import DeSplatModel
from tests.helpers.small_model import HEIGHT, WIDTH, camera, cameras, make_model

VIEW = view_of(cameras()[:1])


def before_the_camera(u: torch.Tensor, v: torch.Tensor, depth: float) -> torch.Tensor:
    """The points that `VIEW` shows at shares of its width and height, at a depth."""
    pixels = torch.stack([u * WIDTH, v * HEIGHT, torch.ones_like(u)])
    in_camera = torch.linalg.inv(VIEW.K) @ pixels * depth
    to_world = torch.linalg.inv(VIEW.viewmat)
    return (to_world[:3, :3] @ in_camera + to_world[:3, 3:]).T


def wall(depth: float) -> torch.Tensor:
    """Points in a plane before the camera, all in its image."""
    u, v = torch.rand(2, 200, generator=torch.Generator().manual_seed(0))
    return before_the_camera(u, v, depth)


def with_a_veil(scale: float = -0.1, **config: float) -> DeSplatModel:
    """A wall at depth 4, and a Gaussian at depth 1 that covers all of the image; its size as a
    logarithm: below 0 the camera is farther than one standard deviation."""
    model = make_model(wall(4.0), **config)
    with torch.no_grad():
        middle = torch.tensor([0.5])
        model.gauss_params["means"][0] = before_the_camera(middle, middle, 1.0)[0]
        model.gauss_params["scales"][0] = scale
        model.gauss_params["opacities"][0] = 9.0
    return model


def covered(model: DeSplatModel) -> bool:
    """Whether every pixel of a rendering is."""
    alpha = model.eval().get_outputs_for_camera(camera(0))["accumulation"]
    return bool((alpha > 0.7).all())


def test_what_is_nearer_than_a_share_of_where_the_points_start_is_not_rendered():
    assert scene_start(wall(4.0), VIEW) == pytest.approx(4.0)
    assert covered(with_a_veil())
    assert covered(with_a_veil(near_plane=0.24))
    model = with_a_veil(near_plane=0.26)
    assert not covered(model)
    assert len(model.params_in(VIEW)["means"]) == len(model.means) - 1


def test_a_few_points_that_are_astray_do_not_tell_where_the_scene_starts():
    points = torch.cat([wall(2.0), wall(5.0), wall(0.1)[:3]])
    assert scene_start(points, VIEW) == pytest.approx(2.0)


def test_what_starts_before_the_scene_and_reaches_the_camera_is_not_rendered():
    assert covered(with_a_veil(0.1))
    assert covered(with_a_veil(-0.1, near_plane=0.1))
    assert not covered(with_a_veil(0.1, near_plane=0.1))


def test_of_a_turned_gaussian_the_deviation_along_the_axis_counts():
    """Long along one axis of its own, thin along the others; then turned by a right angle."""
    axis = VIEW.viewmat[2, :3]
    along = torch.linalg.svd(axis[None]).Vh.T.flip(1)  # its last column is the axis, or against it
    place = before_the_camera(torch.tensor([0.5]), torch.tensor([0.5]), 1.0)
    along = along if torch.det(along) > 0 else along * torch.tensor([-1.0, 1.0, 1.0])
    quats = torch.from_numpy(Rotation.from_matrix(along.numpy()).as_quat(scalar_first=True))
    for scales, clear in (([0.1, 0.1, 2.0], False), ([2.0, 0.1, 0.1], True)):
        given = place, quats[None].float(), torch.tensor([scales]), VIEW
        assert stands_clear(*given, start=4.0, share=0.1).tolist() == [clear]
        assert stands_clear(*given, start=0.9, share=0.1).tolist() == [True]


def test_training_draws_everything():
    model = with_a_veil(near_plane=0.9).train()
    model.optimizers = {}
    assert (model(camera(0))["accumulation"] > 0.7).all()


def test_a_view_without_points_and_a_random_start_have_no_near_plane():
    behind = 2 * wall(0.0)[:1] - wall(4.0)
    assert scene_start(behind, VIEW) == 0
    assert scene_start(torch.cat([behind, wall(3.0)]), VIEW) == pytest.approx(3.0)
    drawn = make_model(wall(4.0), near_plane=0.9, random_init=True, num_random=50).eval()
    assert len(drawn.params_in(VIEW)["means"]) == 50


def test_an_embedding_is_fitted_to_what_is_rendered():
    model = with_a_veil(near_plane=0.5).eval()
    image = as_function_of_embedding(model, VIEW, VIEW.width)(torch.zeros(0))
    rendered = model.get_outputs_for_camera(camera(0))["rgb"]
    torch.testing.assert_close(image, rendered, rtol=0, atol=1e-6)
