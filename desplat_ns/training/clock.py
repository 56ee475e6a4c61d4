"""How long a run takes: by what its steps draw, at prices that are found before the first one and
corrected by those that are done."""

from math import exp, sqrt
from typing import Any

from desplat_ns.core.schedule import RunStep

TIMED_FROM = 100
"""Steps of a run from which on trial steps are worth their time."""

GAUSSIAN, LAYER, LOOK = 7, 0.4, 2_000_000
"""What is drawn besides the pixels of the static scene, in pixels that take as long on a CPU: a
static Gaussian more than at the start; distractors, for each of the photo's pixels; and asking the
other photos about one, once for each when the warm-up is over."""

ADDED, SHARE = 85_000, 0.2
"""Gaussians by which a static set is expected to grow, times the root of a photo's megapixels (seen
were 43,000 to 131,000 on 0.4 to 0.5); and the share of the refinements after which what has grown
says as much of what will."""

TRUST, MEMORY = 5.0, 60.0
"""Seconds of steps that say as much of the run's pace as the trial does; and after which a step
counts 1 / e: other programs come and go."""


class Clock:
    """Seconds of the steps of a run, those ahead included."""

    def __init__(self, pipeline: Any, fixed: float, pixel: float):
        """`fixed`, `pixel`: seconds of a step, whatever it draws, and of a pixel more."""
        self.pipeline, self.fixed, self.pixel = pipeline, fixed, pixel
        self.taken = self.expected = TRUST
        self.start = self._grown()

    def after_step(self, step: int, seconds: float) -> None:
        """Learn what a step took."""
        kept = exp(-seconds / MEMORY)
        self.taken = kept * self.taken + seconds
        self.expected = kept * self.expected + self._seconds_of(step)

    def left(self, step: int, total: int) -> float:
        """Seconds of the steps from one on, until `total` are done."""
        every = 1 + (total - step) // 1000
        ahead = sum(every * self._seconds_of(each) for each in range(step, total, every))
        return ahead * self.taken / self.expected

    def steps_in(self, seconds: float, step: int, total: int) -> int:
        """How many steps a run has in all that ends in so many seconds, by what the steps from one
        on cost if `total` are done."""
        ahead = total - step
        return step + (max(0, int(ahead * seconds / self.left(step, total))) if ahead > 0 else 0)

    def _seconds_of(self, step: int) -> float:
        """A step's, by the prices, with as many Gaussians as are expected then."""
        model, (start, begun), (now, done) = self.pipeline.model, self.start, self._grown()
        config, schedule = model.config, model.schedule
        warmup = config.distractors.warmup
        at = schedule.nominal(RunStep(step))
        drawn = self.pipeline.datamanager.get_train_rays_per_batch()
        ahead = max(0.0, min(1.0, at / config.stop_split_at) - done)
        added = ADDED * sqrt(drawn / 1e6)
        count = now + ahead * (now - start + SHARE * added) / (done - begun + SHARE)
        drawn /= config.downscale_factor(at, drawn) ** 2
        if model.distractors is not None and at >= warmup:
            a_round_ago = schedule.nominal(RunStep(step - model.num_train_data))
            drawn += LAYER * drawn + LOOK * (a_round_ago < warmup)
        drawn += GAUSSIAN * (min(model.strategy.most, count) - start)
        return self.fixed + self.pixel * drawn

    def _grown(self) -> tuple[int, float]:
        """Static Gaussians, and the share of the refinements that is done."""
        model = self.pipeline.model
        done = model.nominal_step / model.config.stop_split_at
        return len(model.gauss_params["means"]), min(1.0, done)
