"""Counts the moments of a training step at which the host would wait for a GPU, on a CPU.

A GPU works through a queue that the host fills. Where the host asks for a value (a number, a mask's
count, a copy), or sends one from memory that is not pinned, it waits until the queue is empty: the
GPU idles until it is filled again. A profiler shows these moments on a GPU. Here they are counted
without one, by the operations that cause them, so that a test can hold their number.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from types import FrameType
from typing import Any

import torch
from nerfstudio.engine.callbacks import TrainingCallbackLocation
from nerfstudio.engine.trainer import Trainer
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

READS = {
    "_local_scalar_dense": "a number is read",
    "equal": "a number is read",
    "nonzero": "elements are counted",
    "masked_select": "elements are counted",
    "_unique2": "elements are counted",
    "unique_dim": "elements are counted",
    "unique_consecutive": "elements are counted",
    "bincount": "elements are counted",
}
"""Operations of torch whose result's value or size the host has to know."""

COPIES = (Tensor.cpu, Tensor.tolist)
"""What copies to the host. `Tensor.numpy` does not: on a GPU one of these has to come before it."""

SENT = (torch.tensor, torch.as_tensor, Tensor.new_tensor)
"""What makes a tensor of numbers of the host, which then goes to the device."""

CPU_ONLY = (torch.quantile, Tensor.quantile, torch.nanquantile, Tensor.nanquantile)
"""Functions that look at a number (whether q is in [0, 1]) on a CPU alone."""

NO_WORK = ("empty", "empty_like", "empty_strided", "new_empty", "_unsafe_view")
"""Operations that set memory aside, or look at it as another shape."""

UPSTREAM = ("torch", "jaxtyping", "beartype")
"""Packages whose own frames do not say where in a step something happens."""


class Synchronisations:
    """Within, counts them by what happens and where.

    The parts of `left_out` do not count. By default these are the backends, as the one for CPUs
    works on the host's memory and a GPU is given to gsplat's; and torch's optimizers, which look at
    their numbers of steps only where these lie on the host. Other values that are on the host
    anyway are counted, so the number is an upper bound.
    """

    def __init__(self, left_out: tuple[str, ...] = ("desplat_ns.backend", "torch.optim")):
        """`left_out`: names of packages; whatever they call is left out."""
        self.counts: Counter[str] = Counter()
        self._left_out = left_out
        self._muted = 0
        self._modes = ExitStack()

    @property
    def total(self) -> int:
        """How many there were."""
        return self.counts.total()

    def __enter__(self) -> Synchronisations:
        self._modes.enter_context(_Functions(self))
        self._modes.enter_context(_Operations(self))
        return self

    def __exit__(self, *error: object) -> None:
        self._modes.close()

    def note(self, what: str) -> None:
        """Count one, unless a part that is left out has called it."""
        where = None if self._muted else _place(sys._getframe(1), self._left_out)
        if where is not None:
            self.counts[f"{what} in {where}"] += 1

    def muted(self, call: Callable[[], Any]) -> Any:
        """The result of a call in which nothing counts."""
        self._muted += 1
        try:
            return call()
        finally:
            self._muted -= 1

    def report(self) -> str:
        """A line for each place, the most frequent first."""
        return "\n".join(f"{count} x {what}" for what, count in self.counts.most_common())


def synchronisations_of(trainer: Trainer, step: int) -> Synchronisations:
    """Those of a whole training step, which is taken: photo, drawing, loss, backward pass,
    optimizers, and what comes after them.

    Args:
        trainer: nerfstudio's or one made from it, set up.
        step: the next one; what is logged, evaluated and saved between steps does not count.
    """
    trainer.pipeline.train()
    with Synchronisations() as counted:
        for callback in trainer.callbacks:
            callback.run_callback_at_location(step, TrainingCallbackLocation.BEFORE_TRAIN_ITERATION)
        trainer.train_iteration(step)
        for callback in trainer.callbacks:
            callback.run_callback_at_location(step, TrainingCallbackLocation.AFTER_TRAIN_ITERATION)
    return counted


class Launches(TorchDispatchMode):
    """Within, counts the operations that a GPU is given, by name: those that make or fill a tensor
    on a device. Views, and memory that is only set aside, are not.

    An operation is one kernel or a few, so the number is a measure and no bound. Fake tensors
    (`torch._subclasses.FakeTensorMode`) do for the device.
    """

    def __init__(self, device: str = "cuda") -> None:
        super().__init__()
        self.counts: Counter[str] = Counter()
        self._device = device

    @property
    def total(self) -> int:
        """How many there were."""
        return self.counts.total()

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[override]
        out = func(*args, **(kwargs or {}))
        name, returns = func.overloadpacket.__name__, func._schema.returns
        is_view = any(ret.alias_info is not None and not ret.alias_info.is_write for ret in returns)
        made = [t.device.type for t in tree_leaves(out) if isinstance(t, Tensor)]
        is_work = not is_view and name not in NO_WORK
        if self._device in made and is_work:
            self.counts[name] += 1
        return out


class _Functions(TorchFunctionMode):
    """Sees calls from Python, also those that do nothing where all memory is the host's."""

    def __init__(self, counted: Synchronisations):
        super().__init__()
        self.counted = counted

    def __torch_function__(self, func, types, args=(), kwargs=None):  # type: ignore[override]
        kwargs = kwargs or {}
        if func in CPU_ONLY:
            return self.counted.muted(lambda: func(*args, **kwargs))
        if func in COPIES:
            self.counted.note("a copy to the host")
        elif func in SENT and not isinstance(args[-1], Tensor):
            self.counted.note("numbers sent to the device")
        return func(*args, **kwargs)


class _Operations(TorchDispatchMode):
    """Sees every operation, also those within others and of backward passes."""

    def __init__(self, counted: Synchronisations):
        super().__init__()
        self.counted = counted

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[override]
        what = _wait_of(func, args, kwargs or {})
        if what is not None:
            self.counted.note(what)
        return func(*args, **(kwargs or {}))


def _wait_of(func: Any, args: tuple[Any, ...], kwargs: dict[str, Any]) -> str | None:
    """What the host waits for in an operation; None if for nothing."""
    name = func.overloadpacket.__name__
    if name in READS:
        return READS[name]
    if name in ("index", "index_put", "index_put_", "_index_put_impl_"):
        masks = (torch.bool, torch.uint8)
        if any(index is not None and index.dtype in masks for index in args[1]):
            return "elements of a mask are counted"
    sized = "output_size" in kwargs and kwargs["output_size"] is not None
    return "elements are counted" if name == "repeat_interleave" and not sized else None


def _place(frame: FrameType | None, left_out: tuple[str, ...]) -> str | None:
    """Module, function and line that called, None where a package of `left_out` did."""
    place = None
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if module.startswith(left_out):
            return None
        own = module == __name__ or module.split(".")[0] in UPSTREAM
        if place is None and not own:
            place = f"{module}.{frame.f_code.co_name}, line {frame.f_lineno}"
        frame = frame.f_back
    return place or "torch"
