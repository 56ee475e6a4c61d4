"""The light of each photo, as a few numbers for the whole image, fitted to the points' colours.

A photo i shows a point p of true colour T in channel c as

    log photo_ipc = gain_ic + gamma_i log T_pc + vignetting_i rho^2 + lens rho^4 + noise

where rho is the distance from the middle of the photo over that of its corners. Both sides are
values of the files, between 0 and 1. Gains are 0 and gammas 1 in the mean of the photos: a light
that all have in common belongs to the scene. All photos share `lens`: rho^2 alone does not explain
how steeply some lenses darken the corners, and what it leaves looks like shade.
Letters in shapes: V photos, P points, M observations that count.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from desplat_ns.survey.observations import Observations

ITERATIONS = 20
"""Of photos' light and points' colours in turn; the figures do not change after a dozen."""
DARKEST = 0.02
"""Values that are nearer to 0 or 1 are clipped: what the camera saw there is not known."""
DARK = 0.08
"""A value of this size counts a quarter: what the camera adds as noise is a larger part of it."""
PRIOR = np.array([0.1, 0.1, 0.1, 2.5, 10.0])
"""Observations that speak for gains 0, gamma 1, no vignetting: a photo with few keeps its light."""
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

    gains: Float[np.ndarray, "V 3"]
    gammas: Float[np.ndarray, " V"]
    vignetting: Float[np.ndarray, " V"]
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
        logs = np.log(np.maximum(colors, LOWEST)) - self.gains[row]
        darker = (self.vignetting[row] + self.lens * rho2) * rho2
        logs = (logs - darker[..., None]) / self.gammas[row]
        return np.exp(np.minimum(logs, 1.0))


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
    logs = np.log(np.maximum(colors, LOWEST))
    weight = (colors / (colors + DARK)) ** 2
    sizes = np.array([view.size for view in observations.views])
    rho2 = from_middle(sizes[photo], observations.places[photo, point])
    rho4 = np.repeat(rho2[:, None] ** 2, 3, axis=1)
    count, num_points = use.shape
    gains, gammas, vignetting, lens = np.zeros((count, 3)), np.ones(count), np.zeros(count), 0.0
    ends, trust = np.searchsorted(photo, np.arange(count + 1)), np.ones((len(photo), 1))

    def explain() -> tuple[np.ndarray, np.ndarray]:
        """Colours that fit the lights best, and what both leave."""
        offset = gains[photo] + (vignetting[photo] * rho2)[:, None] + lens * rho4
        scale = gammas[photo, None]
        true = _means(point, (logs - offset) / scale, weight * trust * scale**2, num_points)
        return true, logs - offset - scale * true[point]

    for _ in range(ITERATIONS + 1):  # all photos have one light
        before = explain()[1]
        trust = _trust(before)
    trust = np.ones((len(photo), 1))
    for _ in range(ITERATIONS if len(photo) else 0):
        true, residual = explain()
        trust = _trust(residual)
        middle = float(np.average(true[point], weights=weight))
        for row in range(count):
            part = slice(ends[row], ends[row + 1])
            shown, sure = true[point[part]], weight[part] * trust[part]
            seen = logs[part] - lens * rho4[part]
            solution = _solve(shown, middle, rho2[part], seen, sure)
            gains[row], gammas[row], vignetting[row] = solution[:3], solution[3], solution[4]
        gammas /= gammas.mean()
        _, residual = explain()
        gains += _joint_gains(photo, point, residual, weight * trust, use.shape)
        gains -= gains.mean(axis=0)
        # At once with the points' colours, as the gains: differences from a point's mean count.
        sure, (_, residual) = weight * trust, explain()
        corner = rho4 - _means(point, rho4, sure, num_points)[point]
        change = (sure * corner * residual).sum() - 3 * LENS_PRIOR * lens
        lens += float(change / ((sure * corner**2).sum() + 3 * LENS_PRIOR))
    true, residual = explain()
    change = logs - residual - true[point]
    return PhotoLight(
        gains, gammas, vignetting, lens, photo, point, change, residual, before, weight
    )


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


def _solve(
    true: np.ndarray, middle: float, rho2: np.ndarray, logs: np.ndarray, weight: np.ndarray
) -> np.ndarray:
    """One photo's gains [3], gamma and vignetting. The unknowns are the light's change at the
    brightness `middle`, where `PRIOR` holds, gamma - 1 and vignetting."""
    rows = np.zeros((len(true), 3, 5))
    rows[:, np.arange(3), np.arange(3)] = 1
    rows[:, :, 3] = true - middle
    rows[:, :, 4] = rho2[:, None]
    flat, sure = rows.reshape(-1, 5), weight.reshape(-1, 1)
    left = flat.T @ (sure * flat) + np.diag(PRIOR)
    solution = np.linalg.solve(left, flat.T @ (sure[:, 0] * (logs - true).reshape(-1)))
    steeper = np.clip(solution[3], -0.8, 4.0)
    return np.array([*(solution[:3] - steeper * middle), 1 + steeper, solution[4]])


def _means(index: np.ndarray, values: np.ndarray, weight: np.ndarray, size: int) -> np.ndarray:
    """Weighted means [size, 3] of rows with the same index."""
    total = [np.bincount(index, values[:, c] * weight[:, c], size) for c in range(3)]
    weights = [np.bincount(index, weight[:, c], size) for c in range(3)]
    return np.stack(total, axis=1) / np.maximum(np.stack(weights, axis=1), 1e-12)
