"""What is wrong with an override is told in the user's terms."""

import shutil

import pytest

from sextant.composing import compose as compose_module
from sextant.composing import config_files
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.lifecycle.sweep_plan import check_sweep_overrides
from sextant.runs.outputs_folder import conf_dir


def told(overrides, function=compose):
    with pytest.raises(UserError) as caught:
        function(overrides)
    return str(caught.value)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("task=foo", "task=foo: no such option\nOptions: calibration, classification"),
        ("dataset=mnits", "Did you mean dataset=mnist?"),
        ("datset=mnist", "Did you mean dataset=mnist?"),
        ("trainer.max_epoch=3", "Did you mean trainer.max_epochs=3?"),
        ("optimizer.learning_rate=3", "unknown key"),
        ("max_epochs=3", "Did you mean trainer.max_epochs=3?"),
        ("lr", "'lr' is not a key=value override"),
        ("a b=c=[", "is not a key=value override"),
        ("optimizer.lr=log_uniform(1e-3,1)", "a range of values needs a search"),
        ("optimizer.lr=normal(0,1)", "is not a key=value override"),
        ("optimizer.lrr=0.1", "Did you mean optimizer.lr=0.1?"),
        ("optimizer.lrr=nan", "Did you mean optimizer.lr? There, optimizer.lr=nan: must be a finite number"),
        ("rnu=foo", "Did you mean reuse? There, reuse='foo': must be 'exact' or 'any_code'"),
    ],
)
def test_one_wrong_override(override, said):
    assert said in told([override])


def test_a_key_within_an_option_that_holds_none_is_unknown():
    assert "corruption.corruptions.gaussian.levels=[0.1]: unknown key" in told(
        ["corruption=none", "corruption.corruptions.gaussian.levels=[0.1]"]
    )


def test_the_wrong_one_of_several_is_named():
    assert "backbone=lenet_z" in told(["dataset=digits", "optimizer.lr=0.1", "backbone=lenet_z"])


@pytest.mark.slow
@pytest.mark.parametrize("key", ["sampling.tilt", "sampling.tlit"])
def test_a_value_of_another_kind_is_never_suggested(key):
    said = told(["task=calibration", f"{key}=[10,-10]"])
    assert said.startswith(f"{key}=[10,-10]: ")
    assert "holds the keys kind, mean, std, low, high, not a list" in said
    assert said.count("[10,-10]") == 1
    assert "holds a list, not keys" in told(["task=calibration", "sampling.roll={kind: uniform}"])


@pytest.fixture
def own_configs(tmp_path, monkeypatch):
    """A copy of ``conf`` that a test may spoil."""
    copy = shutil.copytree(conf_dir(), tmp_path / "conf")
    for module in (compose_module, config_files):
        monkeypatch.setattr(module, "conf_dir", lambda: copy)
    return copy


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"_target_: my.Network\n width: [3\n", "mine.yaml, line 2 is not YAML: mapping values are not allowed here"),
        (b"_target_: my.Network\nwidth: [3\n", "mine.yaml, line 3 is not YAML: expected ',' or ']'"),
        ("_target_: my.Rés".encode("latin-1"), "mine.yaml is not UTF-8: byte 15 is 0xe9"),
    ],
)
def test_a_config_file_that_cannot_be_read_is_named(own_configs, content, said):
    (own_configs / "backbone" / "mine.yaml").write_bytes(content)
    assert f"{own_configs}/backbone/{said}" in told(["backbone=mine"])
    assert compose(["backbone=lenet_b"])["backbone"]["variant"] == "B"


def test_a_missing_mandatory_value_is_named():
    with pytest.raises(UserError, match=r"dataset\.folder has no default"):
        to_plain(compose(["dataset=image_folder"]))


def test_every_choice_of_a_sweep_is_checked_before_it_is_planned():
    assert "backbone=lenet_z" in told(["backbone=lenet_a,lenet_z", "seed=0,1"], check_sweep_overrides)


#: contents that cannot be read, each in its own way
UNREADABLE = (b"a: [1\n", b" a: 1\nb: 2\n", b"a: \xe9\n", b"- 1\n- 2\n", b"\ttab: 1\n", b"a: 'b\n", b"{a\n")


@pytest.mark.parametrize("content", UNREADABLE)
@pytest.mark.parametrize(
    "beside", ["backbone/alone.yaml", "backbone/zzz.yaml", "augmentation/alone.yaml", "own/x.yaml"]
)
def test_a_broken_file_that_nobody_asked_for_is_not_blamed(own_configs, content, beside):
    (own_configs / beside).parent.mkdir(exist_ok=True)
    (own_configs / beside).write_bytes(content)
    assert compose(["backbone=lenet_b"])["backbone"]["variant"] == "B"
    assert "lenet_z: no such option" in told(["backbone=lenet_z"])
    (own_configs / "backbone" / "mine.yaml").write_bytes(b"_target_: my.Net\nwidth: [3\n")
    said = told(["backbone=mine"])
    assert "backbone/mine.yaml, line 3 is not YAML" in said
    assert beside not in said
    assert len(said.splitlines()) <= 2


@pytest.mark.parametrize(
    ("override", "remedy"),
    [
        ("logger=wandb", "tracking.also=[tensorboard,csv,wandb]"), ("logger=mlflow", "tracking=sqlite"),
        ("logger.wandb.project=x", "tracking.also="), ("wandb.project=x", "tracking.also="),
        ("tensorboard=true", "tracking.also="), ("model=lenet", "backbone="), ("model=resnet18", "backbone="),
        ("model.net.lin1_size=64", "backbone="), ("net=resnet", "backbone="), ("network=resnet", "backbone="),
        ("data=mnist", "dataset="), ("data.batch_size=64", "trainer.batch_size"), ("datamodule=cifar", "dataset="),
        ("ckpt_path=last.ckpt", "init_from=last.ckpt"), ("callbacks=default", "trainer.patience"),
        ("callbacks.early_stopping.patience=3", "trainer.patience"),
        ("hparams_search=mnist_optuna", "sweep.search=tpe"), ("preset=quick", "-m sweep="),
        ("backbon=lenet_a", "backbone=lenet_a"), ("trackng=none", "tracking=none"),
    ],
)  # fmt: skip
def test_what_users_of_other_templates_write_names_the_key_here(override, remedy):
    said = told([override])
    assert override.lstrip("+").split("=")[0] in said
    assert remedy in said
    assert "Traceback" not in said
