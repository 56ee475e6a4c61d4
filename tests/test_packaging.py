"""What a user gets from `pip install desplat-ns`: the wheel, alone in a clean environment."""

import importlib.util
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from collections.abc import Callable
from configparser import ConfigParser
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

BUILD = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"

IN_A_CLEAN_ENVIRONMENT = """
import sys
import nerfstudio.configs.method_configs
import desplat_ns.method_configs

print(desplat_ns.__file__)
print({"numba", "pycolmap", "torchmetrics", "trimesh"} & set(sys.modules) or "nothing heavy")
from nerfstudio.scripts.train import entrypoint

sys.argv[1:] = ["desplat", "--help"]
entrypoint()
"""


@pytest.fixture(scope="module")
def wheel(checkout: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of this source tree, built without the network."""
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed: pip install -e '.[dev]'")
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run([sys.executable, "-c", BUILD, folder], cwd=checkout, check=True)
    (built,) = folder.glob("*.whl")
    return zipfile.ZipFile(built)


def test_the_wheel_holds_the_whole_package_and_no_other(checkout: Path, wheel: zipfile.ZipFile):
    """The root's method_configs.py is for checkouts: site-packages gets no module of that name."""
    names = set(wheel.namelist())
    sources = (path.relative_to(checkout) for path in checkout.glob("desplat_ns/**/*.py"))
    assert {path.as_posix() for path in sources} | {"desplat_ns/py.typed"} <= names
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"desplat_ns"}


def test_entry_points_lead_to_specifications_under_their_own_names(wheel: zipfile.ZipFile):
    """A plugin's dataparser replaces nerfstudio's of the same name, for every method."""
    from nerfstudio.configs.dataparser_configs import dataparsers
    from nerfstudio.plugins.registry_dataparser import DataParserSpecification
    from nerfstudio.plugins.types import MethodSpecification

    kinds = {
        "nerfstudio.method_configs": MethodSpecification,
        "nerfstudio.dataparser_configs": DataParserSpecification,
        "console_scripts": Callable,
    }
    parser = ConfigParser(delimiters="=")
    parser.optionxform = str  # type: ignore[assignment]
    (path,) = (n for n in wheel.namelist() if n.endswith(".dist-info/entry_points.txt"))
    parser.read_string(wheel.read(path).decode())
    assert set(parser.sections()) == set(kinds)
    for group, kind in kinds.items():
        for name, value in parser[group].items():
            loaded = EntryPoint(name, value, group).load()
            assert isinstance(loaded, kind), name
            assert kind is not MethodSpecification or loaded.config.method_name == name
    assert not set(parser["nerfstudio.dataparser_configs"]) & set(dataparsers)


def test_ns_train_knows_desplat_from_the_wheel_alone(wheel: zipfile.ZipFile, tmp_path: Path):
    """In an environment that holds the wheel; dependencies come from the running one.

    A folder named in a .pth file is searched, but .pth files inside it are not read: the
    running environment's editable installation of the project stays behind. Every command of
    nerfstudio's registers the methods, so that must import nothing that only training needs.
    """
    venv.create(tmp_path, symlinks=True)
    site = next(tmp_path.glob("lib/python*/site-packages"))
    wheel.extractall(site)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    leaks = {"PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "NERFSTUDIO_METHOD_CONFIGS"}
    shown = subprocess.run(
        [tmp_path / "bin" / "python", "-c", IN_A_CLEAN_ENVIRONMENT],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if k not in leaks} | {"COLUMNS": "200"},
        capture_output=True,
        text=True,
    )
    assert shown.returncode == 0, shown.stderr[-2000:]
    assert str(site) in shown.stdout and "nothing heavy" in shown.stdout
    dataparsers = ("desplat-data", "robustnerf-data", "photo-tourism-data", "on-the-go-data")
    for option in ("--max-num-iterations", "--pipeline.model.backend", *dataparsers):
        assert option in shown.stdout
