"""What `python -m lab.options` writes: every option of the package, as the code has it."""

import re
from functools import reduce

from desplat_ns.method_configs import SWITCHES, desplat
from lab import options


def test_every_option_of_every_method_stands_in_one_table():
    names = [option.name for option in options.options(desplat.config)]
    assert len(names) == len(set(names)) >= 40
    assert {options.part_of(name) for name in names} == set(options.PARTS)
    assert "--pipeline.model.distractors.per-view" in names
    page = options.page()
    assert all(f"| `{name}` |" in page for name in names)


def test_every_option_of_every_command_has_a_meaning():
    for command in options.COMMANDS:
        rows = options.arguments_of(command)
        assert rows and all(row.meaning for row in rows), command


def test_what_the_help_begins_with_are_options():
    names = re.findall(r"(?m)^  --([\w.-]+)", SWITCHES)
    assert len(names) == 10
    for name in names:
        reduce(getattr, name.replace("-", "_").split("."), desplat.config)
