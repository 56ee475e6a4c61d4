import threading
from typing import Any

import pytest
import torch

from desplat_ns.backend import RenderSettings, Splats, resolve
from desplat_ns.backend.numba_kernels.runtime import numba_config
from lab.bench.timing import threads
from tests.backend.scenes import random_scene

SETTINGS = RenderSettings(depth=True, absgrad=True)


def render(scene, settings=SETTINGS):
    return resolve("numba", "cpu")(scene.splats, scene.view, settings)


def render_and_pull(scene) -> list[Any]:
    """Everything that comes out, gradients included."""
    leaves = scene.to(torch.float32)
    out = render(leaves)
    out.means2d.retain_grad()
    rng = torch.Generator().manual_seed(1)
    images: list[Any] = [out.rgb, out.alpha, out.depth]
    for image in images:
        factor = torch.rand(image.shape, generator=rng)
        (image * factor).sum().backward(retain_graph=True)
    grads = [p.grad for p in leaves.parameters]
    return [*images, out.means2d.grad, out.means2d.absgrad, *grads]  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.skipif(numba_config.NUMBA_NUM_THREADS < 2, reason="numba has one thread only")
def test_one_thread_and_two_give_the_same_bits():
    scene = random_scene(21, count=600, size=(131, 77), opacity=(0.1, 0.9))
    results = []
    for number in (1, 2, 2):
        with threads(number):
            results.append(render_and_pull(scene))
    for other in results[1:]:
        assert all(torch.equal(a, b) for a, b in zip(results[0], other, strict=True))


def test_python_threads_may_render_at_the_same_time():
    """As the viewer does while training goes on."""
    # Large enough for calls to meet: without the lock, this ends the process.
    scene = random_scene(22, count=3000, size=(400, 300)).to(torch.float32)
    want = render(scene).rgb
    wrong = []

    def work():
        for _ in range(20):
            if not torch.equal(render(scene).rgb, want):
                wrong.append(1)

    workers = [threading.Thread(target=work) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not wrong


@pytest.mark.parametrize("dtype", [torch.float64, torch.float16])
def test_other_float_dtypes_are_drawn_in_float32_and_get_gradients_in_their_own(dtype):
    scene = random_scene(24).to(dtype)
    out = render(scene)
    assert out.rgb.dtype == torch.float32
    rounded = scene.to(dtype).to(torch.float32)
    assert torch.equal(out.rgb, render(rounded).rgb)
    out.rgb.sum().backward()
    assert all(p.grad is not None and p.grad.dtype == dtype for p in scene.parameters)


def test_non_contiguous_tensors_are_drawn_alike():
    scene = random_scene(25).to(torch.float32)
    strided: dict[str, Any] = {
        "means": scene.means.T.contiguous().T,
        "quats": scene.quats.repeat(1, 2)[:, :4],
        "scales": scene.scales.T.contiguous().T,
        "opacities": scene.opacities.repeat_interleave(2)[::2],
        "colors": scene.colors.flip(-1).contiguous().flip(-1),
    }
    assert not strided["means"].is_contiguous()
    out = resolve("numba", "cpu")(Splats(**strided, sh_degree=None), scene.view, SETTINGS)
    assert torch.equal(out.rgb, render(scene).rgb)


@pytest.mark.parametrize("name", ["means", "colors", "rgb"])
def test_what_changes_in_place_before_the_backward_pass_is_refused(name):
    scene = random_scene(26, sh_degree=2).to(torch.float32)
    rendering = render(scene)
    loss = rendering.rgb.sum() + rendering.alpha.sum()
    with torch.no_grad():
        (rendering.rgb if name == "rgb" else getattr(scene, name)).add_(0.1)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        loss.backward()
