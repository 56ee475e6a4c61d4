"""What nerfstudio 1.1.5 has to be told for runs of this package, each with its reason.

Importing the package changes nothing: our run configuration, trainer, pipeline and commands call
what is here once a run of ours begins.
"""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum
from functools import cache
from itertools import islice
from pathlib import Path
from traceback import walk_stack
from types import MethodType, SimpleNamespace
from typing import Any

import torch
import yaml
from nerfstudio.models.splatfacto import RGB2SH, SplatfactoModel
from nerfstudio.utils import writer
from nerfstudio.utils.rich_utils import CONSOLE
from nerfstudio.viewer import control_panel

from desplat_ns.backend import BackendName, resolve
from desplat_ns.core.checkpoint import load_newest
from desplat_ns.core.console import announce
from desplat_ns.core.errors import BackendUnavailableError, ConfigError, begin_run
from desplat_ns.core.run_files import found
from desplat_ns.metrics import LazyLpips, psnr

_METRICS: dict[str, Any] = {
    "torchmetrics.image": SimpleNamespace(
        PeakSignalNoiseRatio=lambda data_range: lambda *images: torch.tensor(psnr(*images))
    ),
    "torchmetrics.image.lpip": SimpleNamespace(LearnedPerceptualImagePatchSimilarity=LazyLpips),
}
"""What `SplatfactoModel.populate_modules` imports, by module."""


@contextmanager
def splatfacto_modules_without_torchmetrics() -> Iterator[None]:
    """Within, `SplatfactoModel.populate_modules`, which imports both classes by name each time,
    sets `model.lpips` to a `LazyLpips` and `model.psnr` to `metrics.psnr` as a tensor.

    nerfstudio 1.1.5 builds LPIPS with the model: weights are fetched over the network, offline that
    ends in an URLError before the first step, and 10 MB of AlexNet land in every checkpoint.
    """
    before = {name: sys.modules[name] for name in _METRICS if name in sys.modules}
    sys.modules.update(_METRICS)
    try:
        yield
    finally:
        for name in _METRICS:
            del sys.modules[name]
        sys.modules.update(before)


@contextmanager
def splatfacto_modules_without_cuda(model: SplatfactoModel) -> Iterator[None]:
    """Within, `SplatfactoModel.populate_modules` needs no CUDA; seed colours are set afterwards.

    nerfstudio 1.1.5 (splatfacto.py, `populate_modules`) moves the seed colours to CUDA. It skips
    that where there are points without colours, so the colours are withheld during the call.
    The points are copied as well: upstream trains the data parser's own tensor in place.
    """
    seed: Any = model.seed_points
    if seed is None:
        yield
        return
    points, colors = seed
    model.seed_points = (points.detach().clone(), colors[:0])
    try:
        yield
    finally:
        model.seed_points = seed
    if len(colors) > 0 and not model.config.random_init:
        unit = colors.float() / 255  # [N, 3], of 8 bits
        # Half a step from 0 and 1: upstream's 1e-10 has a sigmoid without a slope.
        features = RGB2SH(unit) if model.config.sh_degree > 0 else torch.logit(unit, eps=1 / 510)
        model.gauss_params["features_dc"] = torch.nn.Parameter(features)


_upstream_colormap_options = control_panel._get_colormap_options


def give_masks_a_colormap_in_the_viewer() -> None:
    """Let boolean outputs be chosen in the viewer's menu: nerfstudio 1.1.5 (control_panel.py,
    `_get_colormap_options`) offers no colormap for them, and an IndexError of viser, which cannot
    show an empty menu, ends the thread that renders."""
    control_panel._get_colormap_options = lambda dimensions, dtype: (
        ["default"] if dtype == torch.bool else _upstream_colormap_options(dimensions, dtype)
    )


def train_on_where_logs_cannot_be_written() -> None:
    """Let a run outlive its event files and its console.

    On a full disk TensorBoard's writer raises OSError. nerfstudio 1.1.5 (writer.py,
    `write_out_storage`) lets that end the training, and the steps since the last checkpoint are
    lost. Here it is said once, and nothing more is logged to files. Where the program that reads
    the output has ended (`| head`), rich turns to /dev/null and exits; here it does not exit.
    """
    upstream = writer.write_out_storage
    if upstream.__module__ == __name__:
        return

    def write_out_storage() -> None:
        try:
            upstream()
        except OSError as error:
            announce(f"Nothing more is logged to files: {error}. Training goes on.", warning=True)
            kept = [w for w in writer.EVENT_WRITERS if isinstance(w, writer.LocalWriter)]
            writer.EVENT_WRITERS[:] = kept
            writer.EVENT_STORAGE.clear()

    turn_and_exit = CONSOLE.on_broken_pipe

    def turn_to_dev_null() -> None:
        with suppress(SystemExit):
            turn_and_exit()

    writer.write_out_storage = write_out_storage
    CONSOLE.on_broken_pipe = turn_to_dev_null


def where_to_render(backend: BackendName, device: str | torch.device) -> str | torch.device:
    """The device for a trained model: the CPU where its backend cannot draw on the given one.

    nerfstudio 1.1.5 (eval_utils.py, `eval_setup`) takes CUDA where there is a device, whatever the
    run was trained on and whatever can draw there.
    """
    kind = torch.device(device).type
    if kind != "cuda":
        return device
    try:
        resolve(backend, kind)
        return device
    except BackendUnavailableError as error:
        announce(f"Rendering on the CPU. {error}", warning=True)
        return "cpu"


def use_ffmpeg_of_imageio() -> None:
    """Put the ffmpeg of the package imageio-ffmpeg, if it is installed, on PATH where none is:
    nerfstudio 1.1.5 looks for no other."""
    with suppress(ImportError, RuntimeError):
        if shutil.which("ffmpeg") is None:
            from imageio_ffmpeg import get_ffmpeg_exe

            folder, program = tempfile.mkdtemp(), get_ffmpeg_exe()
            atexit.register(shutil.rmtree, folder)
            Path(folder, "ffmpeg").symlink_to(program)
            os.environ["PATH"] += os.pathsep + folder


def load_evaluated_checkpoints_like_resumed_ones() -> None:
    """Let `ns-eval`, `ns-render`, `ns-viewer` and `ns-export` take the newest intact checkpoint.

    nerfstudio 1.1.5 (eval_utils.py, `eval_load_checkpoint`) loads the newest as it is: truncated,
    it ends in torch's error about a zip archive, and an empty folder in an IndexError. Runs of
    other methods are loaded as before.
    """
    # Not at the top: it keeps the methods that are known when it is imported, this one not yet.
    from nerfstudio.utils import eval_utils

    upstream = eval_utils.eval_load_checkpoint
    if upstream.__module__ == __name__:
        return

    def load(config: Any, pipeline: Any) -> tuple[Path, int]:
        if not type(config).__module__.startswith("desplat_ns."):
            return upstream(config, pipeline)
        path, state = load_newest(found(config.load_dir), config.load_step)
        pipeline.load_pipeline(state["pipeline"], state["step"])
        return path, state["step"]

    eval_utils.eval_load_checkpoint = load


def write_enumerations_by_value() -> None:
    """From now on PyYAML writes members of enumerations as their class and value.

    Python 3.11.0 to 3.11.3 pickles them as a call of `getattr`, and PyYAML writes what pickle says:
    a config.yml that calls a function is not read (`RunLoader`).
    """

    def by_value(dumper: yaml.Dumper, member: Enum) -> yaml.Node:
        named = f"{type(member).__module__}.{type(member).__name__}"
        return dumper.represent_sequence(f"{_STANDARD}python/object/apply:{named}", [member.value])

    yaml.add_multi_representer(Enum, by_value)


UNPICKLES = "minimal-parser"
"""nerfstudio's data parser that reads pickles, which run code, out of a capture."""

_STANDARD = "tag:yaml.org,2002:"


def check_what_is_read() -> None:
    """If PyYAML is making the run configuration of a file, let it make nothing else in this file of
    a Python tag with which no registered method or data parser is written (`RunLoader`).

    Runs are shared, and nerfstudio 1.1.5 writes config.yml with PyYAML's tags of Python objects and
    reads it by `yaml.Loader`, which imports, calls and fills whatever a tag names:
    `!!python/object/apply:os.system [...]` is run. So do `ns-eval`, `ns-render`, `ns-viewer`,
    `ns-export` (eval_utils.py, `eval_setup`) and `ns-train --load-config` (train.py). PyYAML 6
    makes the object of a file's first tag (`make_python_instance`) before it reads what is in it.
    """
    for frame, _ in islice(walk_stack(sys._getframe(1)), 20):
        if frame.f_code.co_name == "make_python_instance":
            loader = frame.f_locals["self"]
            if not isinstance(loader, RunLoader):
                begin_run()
                loader.construct_object = MethodType(RunLoader.construct_object, loader)


class RunLoader(yaml.Loader):
    """Reads the config.yml of a run; a tag that is not trusted raises ConfigError."""

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        """PyYAML's."""
        if node.tag.startswith(f"{_STANDARD}python/") and node.tag not in trusted_tags():
            raise ConfigError(
                f"config.yml names '{node.tag.removeprefix(_STANDARD)}' in line "
                f"{node.start_mark.line + 1}, which no registered method or data parser needs. "
                "Reading the file would run it, so it is not read. If another version of this "
                "package, or of nerfstudio, wrote it, use that version, or train anew; if a plugin "
                "did, install it. Else do not use the file unless you know who wrote it."
            )
        return yaml.Loader.construct_object(self, node, deep)


@cache
def trusted_tags() -> frozenset[str]:
    """The tags with which nerfstudio writes registered methods and data parsers: kind and full
    name, as `python/object:desplat_ns.model_config.DeSplatModelConfig`. Takes a second or two."""
    from nerfstudio.configs.dataparser_configs import all_dataparsers
    from nerfstudio.configs.method_configs import all_methods

    from desplat_ns.data.layouts import OURS, without_prompts

    parsers: dict[str, Any] = {**OURS, **all_dataparsers}
    settled = [without_prompts(parsers[name]) for name in ("colmap", "nerfstudio-data")]
    parsers.pop(UNPICKLES, None)
    tags: set[str | None] = set()
    for config in (*all_methods.values(), *parsers.values(), *settled):
        with suppress(yaml.YAMLError, TypeError):  # a plugin's that cannot be written
            tags |= {getattr(event, "tag", None) for event in yaml.parse(yaml.dump(config))}
    return frozenset(filter(None, tags))
