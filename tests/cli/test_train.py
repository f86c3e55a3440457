"""``train.py`` with config files of one's own."""

import sys

import pytest
from hydra.core.global_hydra import GlobalHydra

from sextant import cli
from sextant.runs.outputs_folder import conf_dir


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A folder with one network, ``backbone=mine``."""
    (tmp_path / "backbone").mkdir()
    (tmp_path / "backbone" / "mine.yaml").write_text((conf_dir() / "backbone" / "lenet_c.yaml").read_text())
    monkeypatch.setattr(sys, "argv", ["train.py"])
    GlobalHydra.instance().clear()
    yield tmp_path
    GlobalHydra.instance().clear()


@pytest.mark.parametrize("spelt", [["--config-dir", "{}"], ["--config-dir={}"], ["-cd", "{}"]])
def test_a_folder_of_config_files_is_found(own, capsys, spelt):
    flag = [word.format(own) for word in spelt]
    cli.run("train", [*flag, "--cfg", "job", "backbone=mine", f"paths.outputs={own}"])
    assert "variant: C" in capsys.readouterr().out


@pytest.mark.slow
def test_its_options_are_named_where_one_is_wrong(own, capsys):
    for arguments, said in (
        ([f"--config-dir={own}", "backbone=min"], "Did you mean backbone=mine?"),
        (["backbone=mine"], "backbone=mine: no such option"),
        (["--config-dir=gone", "backbone=mine"], "config_dir=gone does not exist"),
    ):
        with pytest.raises(SystemExit) as end:
            cli.run("train", arguments)
        assert end.value.code == 2
        assert said in capsys.readouterr().err
