from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from lab.gpu import collect, wheels
from lab.tests.gpu.test_wheels import a_wheel


@pytest.fixture
def offline(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """In pip's place: two small wheels, and what was asked for."""
    asked: list[str] = []

    def download(wanted: Sequence[str], python: str, folder: Path) -> None:
        asked.extend(wanted)
        a_wheel(folder / "thing-1.0-py3-none-any.whl")
        a_wheel(folder / "other-2.0-py3-none-any.whl", lines=100)

    monkeypatch.setattr(collect, "download", download)
    return asked


def test_a_collection_holds_its_wheels_and_says_for_which_python(offline, tmp_path: Path):
    folder = tmp_path / "wheels"
    sizes = collect.collect(folder, "3.12", set())
    assert set(sizes) == {"thing", "other"}
    assert (folder / wheels.MADE_FOR).read_text().strip() == "3.12"
    unpacked = wheels.unpack(folder / wheels.ARCHIVE, tmp_path)
    assert {path.name.partition("-")[0] for path in unpacked} == {"thing", "other"}


def test_torch_and_what_the_machine_has_are_not_asked_for(offline, tmp_path: Path):
    collect.collect(tmp_path / "wheels", "3.12", {"numpy", "scipy"})
    names = {line.partition("==")[0] for line in offline}
    assert "gsplat" in names and "nerfstudio" in names
    assert not names & {"numpy", "scipy", "torch", "torchvision", "triton"}
    assert not any(name.startswith(("nvidia-", "cuda-")) for name in names)
    assert "gsplat==1.4.0" in offline


def test_a_collection_that_is_too_large_is_refused_by_name_and_size(
    offline, tmp_path: Path, monkeypatch, capsys
):
    monkeypatch.setattr(collect, "LIMIT", 2_000)
    folder = tmp_path / "wheels"
    assert collect.main([str(folder), "--python", "3.12"]) == 1
    said = capsys.readouterr().err
    assert "MB  thing" in said and "--has" in said
    assert list(folder.iterdir()) == []


def test_the_limit_itself_is_allowed():
    collect.check_size(collect.LIMIT, {})
    with pytest.raises(collect.CollectionError, match=r"64\.0 MB, and 64 MB may travel"):
        collect.check_size(collect.LIMIT + 1, {})


def test_a_folder_that_holds_anything_is_left_alone(offline, tmp_path: Path, capsys):
    (tmp_path / "mine").write_text("x")
    assert collect.main([str(tmp_path)]) == 1
    assert "not an empty folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"] and offline == []
