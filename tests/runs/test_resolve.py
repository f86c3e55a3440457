"""Which runs are offered to who names one that is not there."""

import pytest

from sextant.errors import UserError
from sextant.runs.directory import RunDirectory
from sextant.runs.resolve import resolve_run


@pytest.fixture
def outputs(tmp_path):
    for name, trained in (("aaaaaaaa-s0", True), ("bbbbbbbb-s0", False)):
        directory = RunDirectory(tmp_path / "runs" / "classification" / name)
        directory.checkpoints.mkdir(parents=True)
        directory.update_state({"failure": None if trained else "UserError: no such module"})
        if trained:
            directory.last_checkpoint.touch()
    return tmp_path


def test_a_run_that_failed_is_not_offered(outputs):
    with pytest.raises(UserError) as caught:
        resolve_run("gone", outputs)
    assert str(caught.value).startswith("run=gone: no run")
    assert "Trained runs here: classification/aaaaaaaa-s0" in str(caught.value)
    assert "bbbbbbbb" not in str(caught.value)


@pytest.mark.parametrize("reference", ["gone", "bbbbbbbb-s0"])
def test_the_key_of_the_user_is_named(outputs, reference):
    with pytest.raises(UserError, match=f"^init_from={reference}: "):
        resolve_run(reference, outputs, "init_from")


def test_only_runs_of_the_folder_of_runs_are_the_users_own(outputs, tmp_path_factory):
    assert resolve_run("aaaaaaaa-s0", outputs).is_own(outputs)
    sent = tmp_path_factory.mktemp("downloads")
    (outputs / "runs").rename(sent / "runs")
    run = sent / "runs" / "classification" / "aaaaaaaa-s0"
    assert not resolve_run(str(run), outputs).is_own(outputs)
    (sent / "alone.ckpt").touch()
    assert not resolve_run(str(sent / "alone.ckpt"), outputs).is_own(outputs)
