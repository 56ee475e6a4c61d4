"""From where a scene may be looked at: the training cameras, and half-way between neighbours. What
no such view shows, no photo has contradicted."""

from collections.abc import Iterable, Iterator

import torch
from jaxtyping import Bool, Float
from nerfstudio.cameras.camera_utils import get_interpolated_poses
from nerfstudio.cameras.cameras import Cameras
from torch import Tensor

from desplat_ns.backend.protocol import Splats, View
from desplat_ns.cameras.in_view import in_view
from desplat_ns.cameras.near_plane import scene_start, stands_clear
from desplat_ns.cameras.views import view_of, views_of

NEIGHBOURS = 3
"""Of each camera. Along a path a camera has two; of cameras spread over a surface three are enough
to go on from any to all around it."""


def neighbours(poses: Float[Tensor, "V 3 4"]) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of cameras, given camera to world, of which one is among the other's
    nearest `NEIGHBOURS`. Only those count whose optical axes are less than a right angle apart:
    between two that look elsewhere nobody looked."""
    places, axes = poses[:, :, 3].double(), poses[:, :, 2].double()
    apart = torch.cdist(places, places).masked_fill(axes @ axes.T <= 0, torch.inf)
    apart.fill_diagonal_(torch.inf)
    nearest, chosen = apart.topk(min(NEIGHBOURS, len(poses)), largest=False)
    first, which = (nearest < torch.inf).nonzero().unbind(1)
    second = chosen[first, which]
    pairs = torch.stack([torch.minimum(first, second), torch.maximum(first, second)], dim=1)
    return [(i, j) for i, j in pairs.unique(dim=0).tolist()]


def allowed_views(cameras: Cameras) -> Iterator[View]:
    """The views of all training cameras, shape [V], then those half-way between neighbours, with
    the lens of one."""
    yield from views_of(cameras)
    poses = cameras.camera_to_worlds
    for i, j in neighbours(poses):
        ends = (poses[k].cpu().double().numpy() for k in (i, j))
        halfway = torch.as_tensor(get_interpolated_poses(*ends, steps=3)[1]).to(poses)
        yield view_of(cameras[i : i + 1], halfway)


@torch.no_grad()
def seen_by_any(
    splats: Splats, views: Iterable[View], points: Float[Tensor, "P 3"] | None, near_plane: float
) -> Bool[Tensor, " N"]:
    """Which Gaussians some view shows: they reach into its image and lie beyond its near plane.

    What stands before them does not count: it may be gone in a view beside.

    Args:
        points: of the reconstruction; without them nothing is too near.
        near_plane: of each view, as a share of the depth at which the scene starts there.
    """
    unseen = torch.arange(len(splats.means), device=splats.means.device)
    for view in views:
        if len(unseen) == 0:
            break
        rest = splats.rows(unseen)
        shown = in_view(rest, view)
        if points is not None and near_plane > 0 and bool(shown.any()):
            shape, start = (rest.means, rest.quats, rest.scales), scene_start(points, view)
            shown &= stands_clear(*shape, view, start, near_plane)
        unseen = unseen[~shown]
    is_seen = torch.ones(len(splats.means), dtype=torch.bool, device=splats.means.device)
    is_seen[unseen] = False
    return is_seen
