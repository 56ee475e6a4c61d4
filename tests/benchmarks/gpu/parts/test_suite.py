from __future__ import annotations

from pathlib import Path

from benchmarks.gpu.parts.suite import MARK, places, read_results

RESULTS = """<testsuites><testsuite>
<testcase classname="tests.a" name="one"/>
<testcase classname="tests.a" name="two"><skipped message="gsplat 1.5 differs"/></testcase>
<testcase classname="tests.a" name="three"><skipped message="gsplat 1.5 differs"/></testcase>
<testcase classname="tests.b" name="four"><failure message="assert 1 == 2&#10;more"/></testcase>
<testcase classname="" name="tests.c"><error message="no module in /some/where/c.py"/></testcase>
</testsuite></testsuites>"""


def test_results_are_counted_and_what_did_not_pass_is_named(tmp_path: Path):
    path = tmp_path / "results.xml"
    path.write_text(RESULTS)
    assert read_results(path) == {
        **{"passed": 1, "failed": 1, "error": 1, "skipped": 2},
        "bad": ["tests.b.four: assert 1 == 2", "tests.c: no module in c.py"],
        "reasons": {"gsplat 1.5 differs": 2},
    }


def test_only_places_that_mark_tests_are_collected(tmp_path: Path):
    for name in ("a/scenes.py", "a/test_x.py", "b/test_y.py"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(f"pytest.{MARK}\n")
    (tmp_path / "b" / "test_z.py").write_text("pytest.mark.slow\n")
    found = [Path(place).relative_to(tmp_path).as_posix() for place in places(tmp_path)]
    assert found == ["a", "b/test_y.py"]


def test_the_contract_of_the_backends_and_the_training_are_among_them(checkout: Path):
    found = {Path(place).name for place in places(checkout / "tests")}
    assert {"backend", "test_training_on_a_gpu.py"} <= found
