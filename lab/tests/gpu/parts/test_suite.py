from __future__ import annotations

from pathlib import Path

from lab.gpu.parts.suite import MARK, places


def test_only_places_that_mark_tests_are_collected(tmp_path: Path):
    for name in ("a/scenes.py", "a/test_x.py", "b/test_y.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"pytest.{MARK}\n")
    (tmp_path / "b" / "test_z.py").write_text("pytest.mark.slow\n")
    collected = [Path(place).relative_to(tmp_path).as_posix() for place in places(tmp_path)]
    assert collected == ["a", "b/test_y.py"]


def test_the_contract_of_the_backends_and_the_training_are_among_them(checkout: Path):
    names = {Path(place).name for place in places(checkout / "tests")}
    assert {"backend", "test_training_on_a_gpu.py"} <= names
