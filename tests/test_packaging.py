"""What a user gets from `pip install desplat-ns`: the wheel, alone in a clean environment."""

from __future__ import annotations

import email
import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Callable
from configparser import ConfigParser
from email.message import Message
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

BUILD = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this source tree, built without the network."""
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed: pip install -e '.[dev]'")
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-c", BUILD, folder], cwd=checkout, check=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def names_in_wheel(wheel: Path) -> set[str]:
    return set(zipfile.ZipFile(wheel).namelist())


def read_info(wheel: Path, name: str) -> str:
    """A file of the wheel's .dist-info folder."""
    archive = zipfile.ZipFile(wheel)
    (path,) = (n for n in archive.namelist() if n.endswith(f".dist-info/{name}"))
    return archive.read(path).decode()


@pytest.fixture(scope="module")
def metadata(wheel: Path) -> Message:
    return email.message_from_string(read_info(wheel, "METADATA"))


@pytest.fixture(scope="module")
def entry_points(wheel: Path) -> list[EntryPoint]:
    parser = ConfigParser(delimiters="=")
    parser.optionxform = str  # type: ignore[assignment]
    parser.read_string(read_info(wheel, "entry_points.txt"))
    return [
        EntryPoint(name, value, g) for g in parser.sections() for name, value in parser[g].items()
    ]


def clean_environment() -> dict[str, str]:
    """The surroundings without what could lead back to the source tree."""
    leaks = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NERFSTUDIO_METHOD_CONFIGS"}
    return {name: value for name, value in os.environ.items() if name not in leaks}


@pytest.fixture(scope="module")
def clean_python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Interpreter of an environment that holds the wheel; dependencies come from the running one.

    A folder named in a .pth file is searched, but .pth files inside it are not read: the
    running environment's editable installation of the project stays behind.
    """
    folder = tmp_path_factory.mktemp("clean") / "env"
    venv.create(folder, with_pip=True, symlinks=True)
    python = folder / "bin" / "python"
    subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", wheel],
        env=clean_environment(),
        check=True,
    )
    site = next(folder.glob("lib/python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def test_every_source_file_is_in_the_wheel(checkout: Path, names_in_wheel: set[str]) -> None:
    sources = {
        path.relative_to(checkout).as_posix() for path in checkout.glob("desplat_ns/**/*.py")
    }
    assert "desplat_ns/backend/protocol.py" in sources
    assert sources <= names_in_wheel


def test_the_wheel_declares_its_types(names_in_wheel: set[str]) -> None:
    assert "desplat_ns/py.typed" in names_in_wheel


def test_the_wheel_brings_no_other_top_level_module(names_in_wheel: set[str]) -> None:
    """The root's method_configs.py is for checkouts: site-packages gets no module of that name."""
    tops = {name.split("/")[0] for name in names_in_wheel}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"desplat_ns"}


def test_the_version_is_the_packages(metadata: Message) -> None:
    import desplat_ns

    assert metadata["Version"] == desplat_ns.__version__
    assert metadata["Name"] == "desplat-ns"
    assert metadata["License-Expression"] == "Apache-2.0"


def required_names(metadata: Message) -> set[str]:
    """Names of the distributions that the wheel requires, extras included."""
    requirements = metadata.get_all("Requires-Dist") or []
    return {re.split(r"[^\w.-]", line)[0].lower() for line in requirements}


PINNED_BY_TORCH = {"cuda-toolkit", "nvidia-cuda-cccl"}
"""Each build of torch goes with one release; another pin would exclude the other builds."""


def test_every_requirement_has_a_version_known_to_work(checkout: Path, metadata: Message) -> None:
    text = (checkout / "constraints.txt").read_text()
    pinned = {name.lower() for name in re.findall(r"^([\w.-]+)==", text, flags=re.MULTILINE)}
    assert required_names(metadata) - PINNED_BY_TORCH <= pinned


def test_entry_points_lead_to_specifications(entry_points: list[EntryPoint]) -> None:
    from nerfstudio.plugins.registry_dataparser import DataParserSpecification
    from nerfstudio.plugins.types import MethodSpecification

    kinds = {
        "nerfstudio.method_configs": MethodSpecification,
        "nerfstudio.dataparser_configs": DataParserSpecification,
        "console_scripts": Callable,
    }
    assert {point.group for point in entry_points} == set(kinds)
    for point in entry_points:
        assert isinstance(point.load(), kinds[point.group]), point


def test_methods_are_registered_under_their_own_names(entry_points: list[EntryPoint]) -> None:
    methods = [point for point in entry_points if point.group == "nerfstudio.method_configs"]
    assert {point.name for point in methods} == {p.load().config.method_name for p in methods}


def test_no_dataparser_takes_a_name_of_nerfstudios(entry_points: list[EntryPoint]) -> None:
    """A plugin's dataparser replaces nerfstudio's of the same name, for every method."""
    from nerfstudio.configs.dataparser_configs import dataparsers

    from desplat_ns.layouts.choices import OURS

    group = "nerfstudio.dataparser_configs"
    ours = {point.name for point in entry_points if point.group == group}
    assert ours == set(OURS)
    assert not ours & set(dataparsers)


def test_the_clean_environment_holds_the_wheels_package(clean_python: Path) -> None:
    done = subprocess.run(
        [clean_python, "-c", "import desplat_ns; print(desplat_ns.__file__)"],
        cwd=clean_python.parent,
        env=clean_environment(),
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()).is_relative_to(clean_python.parent.parent)


PARSE = "from desplat_ns.studies.methods import parse"


def test_studies_are_in_the_wheel_and_need_no_checkout(clean_python: Path) -> None:
    done = subprocess.run(
        [clean_python, "-c", f"{PARSE}; print(parse('desplat', []).nominal_num_iterations)"],
        cwd=clean_python.parent,
        env=clean_environment(),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.split()[-1].isdigit()


def test_ns_train_knows_desplat_from_the_wheel_alone(clean_python: Path) -> None:
    script = Path(sysconfig.get_path("scripts")) / "ns-train"
    shown = subprocess.run(
        [clean_python, script, "desplat", "--help"],
        cwd=clean_python.parent,
        env=clean_environment() | {"COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    assert shown.returncode == 0, shown.stderr[-2000:]
    dataparsers = ("desplat-data", "robustnerf-data", "photo-tourism-data", "on-the-go-data")
    for option in ("--max-num-iterations", "--pipeline.model.backend", *dataparsers):
        assert option in shown.stdout
