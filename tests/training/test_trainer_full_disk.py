"""A disk that is full costs a run no step, and a last save that fails ends it with its reason."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import pytest

from desplat_ns.core.checkpoint import STAGING_FOLDER, checkpoints_in
from desplat_ns.core.errors import CheckpointError, ConfigError
from tests.helpers.stub_run import config as config
from tests.helpers.stub_run import resumed, set_up, train


@contextmanager
def full_disk(room: int) -> Iterator[None]:
    """Within, no file can become larger than `room` bytes."""
    resource = pytest.importorskip("resource", reason="needs a file size limit to fill the disk")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # the log's
def test_a_save_that_fails_on_the_way_costs_no_step(config, capsys):
    """Saves are due after steps 5 and 10 and at the end; the disk is full at 10."""
    trainer = set_up(config)
    with ExitStack() as stack:

        def fill(step: int) -> None:
            if step == 8:
                stack.enter_context(full_disk(1000))
            elif step == 11:
                stack.close()

        trainer.pipeline.at_step = fill
        trainer.train()
    assert trainer.pipeline.trained == list(range(12))
    names = [path.name for path in checkpoints_in(config.get_checkpoint_dir())]
    assert names == ["step-000000005.ckpt", "step-000000011.ckpt"]
    said = " ".join(capsys.readouterr().out.split())
    assert "step-000000010.ckpt" in said


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # the log's
def test_a_last_save_that_fails_ends_the_run_with_its_reason(config, capsys):
    trainer = set_up(config)
    with ExitStack() as stack:
        trainer.pipeline.at_step = lambda step: (
            stack.enter_context(full_disk(1000)) if step == 8 else None
        )
        with pytest.raises(CheckpointError, match=r"000011\.ckpt"):
            trainer.train()  # capsys: what is printed goes to memory, which is not full
    saved = config.get_base_dir().glob("nerfstudio_models/*")
    assert [path.name for path in saved] == ["step-000000005.ckpt"]
    assert not (config.get_base_dir() / STAGING_FOLDER).exists()
    assert train(resumed(config)).pipeline.trained == list(range(6, 12))


def test_a_disk_that_is_full_from_the_start_is_a_plain_error(config, capsys):
    with full_disk(0), pytest.raises(ConfigError, match="written"):
        set_up(config)
    assert not config.get_base_dir().exists()
