"""The two layers at one pixel: the smallest model that shows what separates them and what does not.

Every view sees the same static colour s through its own distractor of colour r and opacity a, and
compares c = a r + (1 - a) s with its photo y. In a few views y is an occluder's colour.

python -m lab.separation.one_pixel        (draws docs/explain/one_pixel.png)
"""

from dataclasses import dataclass
from pathlib import Path

import torch

from lab import DOCS, parser_of

VIEWS, OCCLUDED = 40, 8
TRUTH, OCCLUDER = 0.3, 0.9
"""Colours in [0, 1] of the scene and of what stands in front of it in `OCCLUDED` of the views."""

STATIC_RATE, COLOR_RATE, OPACITY_RATE = 2.5e-3, 0.025, 0.05
"""Learning rates of s, r and the logit of a, as in B.3."""


@dataclass(frozen=True)
class Rules:
    """How one pixel is trained."""

    label: str
    lambda_d: float = 0.01
    warmup: int = 0
    """Steps without distractors."""
    alone: bool = False
    """s has a loss of its own, where a is below 0.5; the composite trains r and a."""
    placed: bool = False
    """Distractors exist only where the residual after the warm-up exceeds 0.1, in the photo's
    colour and half opaque."""


RULES = (
    Rules("one loss, lambda_d 0.01 (paper)"),
    Rules("one loss, lambda_d 0.1", lambda_d=0.1),
    Rules("one loss, lambda_d 0.1, warm-up", lambda_d=0.1, warmup=400),
    Rules("s alone, lambda_d 0.1, warm-up, placed", 0.1, warmup=400, alone=True, placed=True),
)


TITLES = ("error of the static colour", "opacity in free views", "opacity in occluded views")


def simulate(rules: Rules, steps: int = 3000) -> torch.Tensor:
    """Train one pixel: a random view in each step, Adam as in training.

    Returns:
        Per step what `TITLES` names, opacities as means over views, [steps, 3].
    """
    # What each view shows at the pixel, with the noise of a texture not learned yet.
    y = 0.03 * torch.randn(VIEWS, generator=torch.Generator().manual_seed(0))
    y = y + torch.where(torch.arange(VIEWS) < OCCLUDED, OCCLUDER, TRUTH)
    generator = torch.Generator().manual_seed(1)
    s = torch.tensor(0.5, requires_grad=True)
    r = torch.rand(VIEWS, generator=generator).unbind()
    r = [v.clone().requires_grad_() for v in r]
    logit = [torch.tensor(0.1).logit().requires_grad_() for _ in range(VIEWS)]
    optimizer = torch.optim.Adam(
        [
            {"params": [s], "lr": STATIC_RATE},
            {"params": r, "lr": COLOR_RATE},
            {"params": logit, "lr": OPACITY_RATE},
        ],
        eps=1e-15,
    )
    exists = [not rules.placed] * VIEWS
    trace = []
    for step in range(steps):
        v = int(torch.randint(VIEWS, (), generator=generator))
        if rules.placed and step >= rules.warmup and not exists[v]:
            exists[v] = bool((s - y[v]).abs() > 0.1)
            with torch.no_grad():
                r[v].copy_(y[v])
                logit[v].zero_()
        optimizer.zero_grad(set_to_none=True)
        _loss(rules, s, r[v], logit[v], y[v], step >= rules.warmup and exists[v]).backward()
        optimizer.step()
        opacity = torch.stack([raw.sigmoid() for raw in logit]).detach() * torch.tensor(exists)
        opacity *= step >= rules.warmup
        shares = opacity[OCCLUDED:].mean().item(), opacity[:OCCLUDED].mean().item()
        trace.append((abs(s.item() - TRUTH), *shares))
    return torch.tensor(trace)


def _loss(rules: Rules, s, r, logit, y, drawn: bool) -> torch.Tensor:
    if not drawn:
        return (s - y).abs()
    a = logit.sigmoid()
    beneath = s.detach() if rules.alone else s
    loss = (a * r + (1 - a) * beneath - y).abs() + rules.lambda_d * a
    return loss + (s - y).abs() * (a.detach() < 0.5) if rules.alone else loss


def draw(path: Path) -> None:
    """Three panels: the static colour's error, opacity where nothing is, where something is."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, 3)
    for rules in RULES:
        for axes, values in zip(panels, simulate(rules).T, strict=True):
            axes.plot(values, label=rules.label, lw=1.2)
    for axes, title in zip(panels, TITLES, strict=True):
        axes.set(title=title, xlabel=f"steps ({VIEWS} views)", ylim=(0, None))
        axes.grid(True, alpha=0.25)
    panels[1].legend(frameon=False, fontsize=7)
    figure.savefig(path, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    parser_of("python -m lab.separation.one_pixel", __doc__).parse_args()
    draw(DOCS / "explain" / "one_pixel.png")
