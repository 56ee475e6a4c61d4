"""What a run has cost, and where it lies, as its page says it."""

from pathlib import Path

from desplat_ns.report.cost import from_here


def test_a_path_below_the_folder_at_hand_is_said_from_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert from_here(tmp_path / "outputs" / "config.yml") == "outputs/config.yml"
    assert from_here(Path("outputs") / "config.yml") == "outputs/config.yml"


def test_a_path_elsewhere_stays_as_it_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    elsewhere = tmp_path.parent / "other" / "config.yml"
    assert from_here(elsewhere) == str(elsewhere)
    assert from_here(None) == ""
