"""The page to look at while a run trains: it shows the run, and changes nothing of it."""

from desplat_ns.core.checkpoint import load_newest
from desplat_ns.training import preview
from tests.helpers.registered import set_up
from tests.helpers.stub_run import assert_same


def test_a_page_after_each_step_shows_photos_and_changes_no_bit(tiny_run, tmp_path, monkeypatch):
    states = []
    for name, every, cost in (("without", 1e9, -1.0), ("with", 0.0, 1e9)):
        monkeypatch.setattr(preview, "EVERY", every)
        monkeypatch.setattr(preview, "COST", cost)
        config = tiny_run(tmp_path / name)
        config.max_num_iterations = 12
        trainer = set_up(config, 1)
        trainer.train()
        states.append(load_newest(trainer.checkpoint_dir)[1])
        page = (trainer.base_dir / "preview.html").read_text()
        assert "The run is over" in page and "refresh" not in page
        assert "<img" in page
        assert (len(trainer.preview.curve) > 1) == (name == "with")  # one when it ends
    for state in states:
        del state["rng"]["python"]  # the checks of types in tests draw from it
    assert_same(*states)
