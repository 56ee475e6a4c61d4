"""Fixtures and settings for every test.

`desplat_ns` is imported inside the fixtures only: this file is read before jaxtyping's import hook
is in place, and what is imported before the hook goes unchecked.
"""

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

# Before anything loads OpenMP: waiting threads sleep instead of spinning.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, settings

# Before any pycolmap: pycolmap 4.2.1 imported first corrupted the heap when PNGs were written.
from PIL import Image

if TYPE_CHECKING:
    from nerfstudio.engine.trainer import TrainerConfig

    from lab.synthetic import Scene

torch.set_num_threads(1)  # the tensors of tests are small: more threads only wait for each other

# The first example pays for compilation, so a time limit per example would fail at random. The
# suite draws the same examples every time, everywhere; `make fuzz` draws new ones.
settings.register_profile(
    "desplat",
    deadline=None,
    max_examples=40,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("fuzz", settings.get_profile("desplat"), derandomize=False)
settings.load_profile("desplat")

SLOW_FIXTURES = {"tiny_run", "wheel", "yard"}
"""What uses one of these, itself or by another fixture, trains, installs or poses photos."""

QUICK, QUICK_SECONDS = "not slow", 1.0
"""The choice of `make test-quick`, and the seconds of CPU time above which a test belongs to the
slow ones. The imports of the first tests of a process are not theirs."""

DATA_VARIABLE = "DESPLAT_NS_DATA"
POINTS = ("1 0.5 -1 4 10 20 30 0.25 1 0 2 0", "2 1 2 3 200 100 50 0.5 1 1")
"""COLMAP's lines for two points, seen in the first photos."""


def pytest_configure(config: pytest.Config) -> None:
    """Hide GPUs from the suite and from the processes that it starts, so that it is the same on
    every machine. The tests that need one run by themselves: `-m gpu`."""
    if config.option.markexpr != "gpu":
        os.environ["CUDA_VISIBLE_DEVICES"] = ""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what is marked `gpu` where GPUs are hidden or there is none."""
    is_asked = item.config.option.markexpr == "gpu" and torch.cuda.is_available()
    if item.get_closest_marker("gpu") and not is_asked:
        pytest.skip("needs a CUDA device, and `-m gpu`, without which GPUs are hidden")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as slow what uses a fixture that is, and put what is slow first: else one process works
    at the end while the others have nothing left."""
    for item in items:
        if SLOW_FIXTURES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Measure the CPU time of a test, its child processes included."""
    before, modules = sum(os.times()[:4]), len(sys.modules)
    yield
    imported = len(sys.modules) - modules
    item.user_properties.append(("cpu", sum(os.times()[:4]) - before if imported < 20 else 0.0))


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """After a quick run: tests that are not marked as slow, and are."""
    if config.option.markexpr != QUICK:
        return
    reports = [one for one in terminalreporter.getreports("passed") if one.when == "call"]
    took = [(dict(one.user_properties).get("cpu", 0.0), one.nodeid) for one in reports]
    for seconds, name in sorted(one for one in took if one[0] > QUICK_SECONDS):
        line = f"{name} took {seconds:.1f} s of CPU time: mark it with @pytest.mark.slow"
        terminalreporter.write_line(line, yellow=True)


@pytest.fixture(autouse=True)
def _nothing_said() -> None:
    """What is announced once in a process is announced in each test."""
    if "desplat_ns.core.console" in sys.modules:
        sys.modules["desplat_ns.core.console"].announce_once.cache_clear()


@pytest.fixture(scope="session")
def data_folder() -> Callable[[str], Path]:
    """`data_folder("fox")`: that real scene, or a skip that says how to provide it."""

    def find(name: str) -> Path:
        root = os.environ.get(DATA_VARIABLE)
        if not root:
            pytest.skip(f"set {DATA_VARIABLE} to the folder that holds the scene '{name}'")
        folder = Path(root).expanduser() / name
        if not folder.is_dir():
            pytest.skip(f"{DATA_VARIABLE}={root} holds no scene '{name}'")
        return folder

    return find


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root of the source tree."""
    return Path(__file__).resolve().parent


@pytest.fixture(scope="session")
def tiny_scene(tmp_path_factory: pytest.TempPathFactory) -> "Scene":
    """A generated capture of six 48x32 views with known truth; shared: do not write into it."""
    from lab.synthetic import SceneSpec, write_scene

    return write_scene(SceneSpec.tiny(), tmp_path_factory.mktemp("tiny_scene"))


@pytest.fixture
def tiny_copy(tiny_scene: "Scene", tmp_path: Path) -> Path:
    """The tiny scene (6 clean, 6 clutter, 2 extra) in a folder that may be changed."""
    assert tiny_scene.folder is not None
    return Path(shutil.copytree(tiny_scene.folder, tmp_path / "scene"))


@pytest.fixture(scope="session")
def eight_views(tmp_path_factory: pytest.TempPathFactory) -> "Scene":
    """A generated capture for runs with every setting as registered; shared: do not write into
    it."""
    from lab.synthetic import write_scene
    from tests.helpers.registered import EIGHT_VIEWS

    return write_scene(EIGHT_VIEWS, tmp_path_factory.mktemp("eight_views"))


@pytest.fixture(scope="session")
def tiny_run(tiny_scene: "Scene") -> "Callable[[Path], TrainerConfig]":
    """`ns-train desplat` on the tiny scene into a folder: 24 steps, a few refinements, no survey.

    With distractors from the first step on, as in the paper: 24 steps leave no time for a warm-up.
    """

    def configure(output: Path) -> "TrainerConfig":
        from desplat_ns.core.effects import EffectsConfig
        from desplat_ns.distractors.config import DistractorConfig
        from tests.helpers.registered import registered_desplat

        evaluated = {"steps_per_eval_image": 10, "steps_per_eval_all_images": 20}
        short = {"max_num_iterations": 24, "experiment_name": "tiny", **evaluated}
        config = registered_desplat(tiny_scene, output, **short)
        model = config.pipeline.model
        model.effects = EffectsConfig()
        model.num_downscales, model.schedule_scale = 0, 0.02
        model.distractors = DistractorConfig(per_view=40, refine_visits=1)
        return config

    return configure


@pytest.fixture(scope="session")
def trained(
    tiny_run: "Callable[[Path], TrainerConfig]", tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """config.yml of a run of `ns-train` on the tiny scene; shared: do not write beside it."""
    from nerfstudio.scripts import train

    config = tiny_run(tmp_path_factory.mktemp("runs"))
    train.main(config)
    return config.get_base_dir() / "config.yml"


def write_model(
    folder: Path,
    names: Sequence[str],
    cameras: Sequence[str] = ("1 PINHOLE 8 6 10 11 4 3",),
    points: Sequence[str] = POINTS,
) -> Path:
    """COLMAP's text format: photo i stands at x = i, looks along +z, has camera min(i, last)."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    lines = []
    for i, name in enumerate(names):
        camera_id = min(i + 1, len(cameras))
        observed = "1 1 1 2 2 2" if i == 0 else "1 1 1"
        lines += [f"{i + 1} 1 0 0 0 {-i} 0 0 {camera_id} {name}", observed]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text("\n".join(points) + "\n")
    return folder


def write_photo(
    path: Path, width: int = 8, height: int = 6, seed: int = 0, **options
) -> np.ndarray:
    """A photo of noise; returns its pixels."""
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(pixels).save(path, **options)
    return pixels


@pytest.fixture
def model_writer() -> Callable[..., Path]:
    return write_model


@pytest.fixture
def photo_writer() -> Callable[..., np.ndarray]:
    return write_photo


@pytest.fixture
def capture(tmp_path: Path) -> Callable[..., Path]:
    """`capture(names, **of_write_model)`: a folder with `images` and `sparse/0`, written by hand:
    COLMAP's text files line by line, photos of noise."""

    def make(names: Sequence[str] = ("a.png", "b.png", "c.png"), **options) -> Path:
        data = tmp_path / "capture"
        write_model(data / "sparse" / "0", names, **options)
        for seed, name in enumerate(names):
            write_photo(data / "images" / name, seed=seed)
        return data

    return make


@pytest.fixture
def unchecked_types() -> Iterator[None]:
    """Within, nothing checks the types of arguments, which makes small functions ten times faster:
    for half a million calls of one that other tests call with checks."""
    import jaxtyping

    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture
def tyro_may_build(unchecked_types: None) -> None:
    """Within, classes take nerfstudio's own defaults, such as `weight_decay: float = 0`, from tyro.

    The type checks of these tests would refuse that 0, which is no float.
    """
