"""The light of each photo, as a few numbers for the whole image, fitted to the points' colours.

A photo shows a point as `camera_response` shows its true colour, times exp(lens rho^4), where rho
is the distance from the middle of the photo over that of its corners. Logarithms of gains and gamma
are 0 in the mean of the photos: a light that all have in common belongs to the scene. All photos
share `lens`: rho^2 alone does not explain how steeply some lenses darken the corners, and what it
leaves looks like shade.
Letters in shapes: V photos, P points, M observations that count.
"""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int

from desplat_ns.photo_tourism.camera_response import (
    NUMBERS,
    camera_response,
    response_step,
    scene_colors,
)
from desplat_ns.survey.observations import Observations

ITERATIONS = 20
"""Of photos' light and points' colours in turn; the figures do not change after a dozen."""
DARKEST = 0.02
"""Values that are nearer to 0 or 1 are clipped: what the camera saw there is not known."""
DARK = 0.08
"""A value of this size counts a quarter: what the camera adds as noise is a larger part of it."""
PRIOR = (0.1, 0.1, 0.1, 2.5, 10.0)
"""Observations that speak for each number being 0: a photo with few keeps its light. Of gains they
hold the change at the mean brightness, whatever gamma is."""
JOINT_PRIOR = 0.001
"""Observations that hold all gains, whose common part nothing determines, when they are changed."""
LENS_PRIOR = 1.0
"""Observations in the very corners that speak for a lens that darkens them by rho^2 alone."""
FEWEST = 15
"""Observations without which a photo's light is not known."""
LOWEST = 1 / 255


@dataclass(frozen=True)
class PhotoLight:
    """The fitted light and what it was fitted to."""

    numbers: Float[np.ndarray, "V 5"]
    """Of each photo's `camera_response`."""
    lens: float
    photo: Int[np.ndarray, " M"]
    """Which photo an observation is of, ascending."""
    point: Int[np.ndarray, " M"]
    change: Float[np.ndarray, "M 3"]
    """What the photo's light does to the true colour, in log."""
    residual: Float[np.ndarray, "M 3"]
    """What the light leaves, in log."""
    residual_before: Float[np.ndarray, "M 3"]
    """What is left if all photos have one light."""
    weight: Float[np.ndarray, "M 3"]
    """Less for dark values, in [0, 1]."""

    def neutral(
        self, row: int, colors: Float[np.ndarray, "*N 3"], rho2: Float[np.ndarray, "*N"]
    ) -> Float[np.ndarray, "*N 3"]:
        """Colours of one photo, seen at rho^2, as the mean light would show them."""
        rho2 = np.minimum(rho2, 1.0)  # what is outside of the photo does not count
        colors = np.maximum(colors, LOWEST) / np.exp(self.lens * rho2**2)[..., None]
        return np.minimum(_inverse(colors, self.numbers[row], rho2), np.e)


def from_middle(
    size: Int[np.ndarray, "*N 2"] | tuple[int, int], places: Float[np.ndarray, "*N 2"]
) -> Float[np.ndarray, "*N"]:
    """rho^2: 0 in the middle of a photo of that width and height, 1 in its corners."""
    half = np.asarray(size) / 2
    return ((places - half) ** 2).sum(axis=-1) / (half**2).sum(axis=-1)


def fit_light(observations: Observations) -> PhotoLight:
    """Every photo's light by least squares with Cauchy's weights, colours and lights in turn."""
    clipped = (observations.colors < DARKEST) | (observations.colors > 1 - DARKEST)
    use = observations.is_tracked & ~clipped.any(axis=-1)
    use &= use.sum(axis=0) >= 2
    photo, point = np.nonzero(use)
    colors = observations.colors[photo, point].astype(np.float64)
    weight = (colors / (colors + DARK)) ** 2
    sizes = np.array([view.size for view in observations.views])
    rho2 = from_middle(sizes[photo], observations.places[photo, point])
    rho4 = np.repeat(rho2[:, None] ** 2, 3, axis=1)
    count, num_points = use.shape
    numbers, lens = np.zeros((count, NUMBERS)), 0.0
    ends, trust = np.searchsorted(photo, np.arange(count + 1)), np.ones((len(photo), 1))

    def explain() -> tuple[np.ndarray, np.ndarray]:
        """Colours that fit the lights best, and what both leave, in log."""
        seen, own = colors / np.exp(lens * rho4), numbers[photo]
        sure = weight * trust * np.exp(2 * own[:, 3:4])
        logs = np.log(np.maximum(_inverse(seen, own, rho2), LOWEST))
        true = np.exp(_means(point, logs, sure, num_points))
        shown = camera_response(*_tensors(true[point], own, rho2[:, None])).numpy()
        return true, np.log(seen) - np.log(shown)

    for _ in range(ITERATIONS + 1):  # all photos have one light
        before = explain()[1]
        trust = _trust(before)
    trust = np.ones((len(photo), 1))
    for _ in range(ITERATIONS if len(photo) else 0):
        true, residual = explain()
        trust = _trust(residual)
        prior = _prior(float(np.average(np.log(true[point]), weights=weight)))
        seen, sure = colors / np.exp(lens * rho4), trust / (colors + DARK) ** 2
        for row in range(count):
            part = slice(ends[row], ends[row + 1])
            own, rgb, shown = _tensors(numbers[row], true[point[part]], seen[part])
            radius2, weights = _tensors(rho2[part, None], sure[part])
            neutral = torch.zeros_like(own)
            after = response_step(own, rgb, shown, radius2, weights, prior, neutral)
            numbers[row] = after.numpy()
        numbers[:, 3] -= numbers[:, 3].mean()
        _, residual = explain()
        numbers[:, :3] += _joint_gains(photo, point, residual, weight * trust, use.shape)
        numbers[:, :3] -= numbers[:, :3].mean(axis=0)
        # At once with the points' colours, as the gains: differences from a point's mean count.
        sure, (_, residual) = weight * trust, explain()
        corner = rho4 - _means(point, rho4, sure, num_points)[point]
        change = (sure * corner * residual).sum() - 3 * LENS_PRIOR * lens
        lens += float(change / ((sure * corner**2).sum() + 3 * LENS_PRIOR))
    true, residual = explain()
    change = np.log(colors) - residual - np.log(true[point])
    return PhotoLight(numbers, lens, photo, point, change, residual, before, weight)


def _tensors(*arrays: np.ndarray) -> list[torch.Tensor]:
    return [torch.from_numpy(array) for array in arrays]


def _inverse(seen: np.ndarray, numbers: np.ndarray, rho2: np.ndarray) -> np.ndarray:
    """`scene_colors`, of arrays."""
    return scene_colors(*_tensors(seen, numbers, rho2[..., None])).numpy()


def _prior(middle: float) -> torch.Tensor:
    """`PRIOR` as a matrix: of the light's change at the brightness exp(middle), gamma and the
    vignetting."""
    at_middle = torch.eye(NUMBERS, dtype=torch.float64)
    at_middle[:3, 3] = middle
    return at_middle.T @ torch.tensor(PRIOR, dtype=torch.float64).diag() @ at_middle


def _trust(residual: np.ndarray) -> np.ndarray:
    """Cauchy's weights [M, 1], of the channel that fits worst."""
    spread = robust_spread(residual) + 1e-4
    return (1 / (1 + (residual / (2 * spread)) ** 2)).min(axis=1, keepdims=True)


def robust_spread(values: Float[np.ndarray, "*N"]) -> float:
    """Standard deviation about 0 of what is normal among the values, from their median size."""
    return 1.4826 * float(np.median(np.abs(values))) if values.size else float("nan")


def _joint_gains(
    photo: np.ndarray, point: np.ndarray, residual: np.ndarray, weight: np.ndarray, count: tuple
) -> np.ndarray:
    """Changes [V, 3] of all gains at once that lessen the residual most.

    Alone, photos that share few points creep towards one another: a light that changes slowly along
    a walk around the scene would take hundreds of turns. Points are eliminated: with weights W
    [V, P], the matrix is diag(W 1) - W diag(1 / W^T 1) W^T.
    """
    changes = np.zeros((count[0], 3))
    table, wanted = np.zeros(count), np.zeros(count)
    for channel in range(3):
        table[photo, point] = weight[:, channel]
        wanted[photo, point] = weight[:, channel] * residual[:, channel]
        share = table / np.maximum(table.sum(axis=0), 1e-12)
        left = np.diag(table.sum(axis=1) + JOINT_PRIOR) - share @ table.T
        right = (wanted - share * wanted.sum(axis=0)).sum(axis=1)
        changes[:, channel] = np.linalg.solve(left, right)
    return changes


def _means(index: np.ndarray, values: np.ndarray, weight: np.ndarray, size: int) -> np.ndarray:
    """Weighted means [size, 3] of rows with the same index."""
    total = [np.bincount(index, values[:, c] * weight[:, c], size) for c in range(3)]
    weights = [np.bincount(index, weight[:, c], size) for c in range(3)]
    return np.stack(total, axis=1) / np.maximum(np.stack(weights, axis=1), 1e-12)
