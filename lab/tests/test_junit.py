from __future__ import annotations

from pathlib import Path

from lab.junit import read_results

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
