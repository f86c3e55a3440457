"""A trained model is tested and used from its checkpoint alone."""

import json
import random
import shutil

import numpy as np
import pytest
import torch
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from support import quick_config

from sextant.cli import evaluate, predict
from sextant.data.digits import Digits
from sextant.errors import UserError
from sextant.lifecycle.execute import execute
from sextant.runs.checkpoint import KEY, load_checkpoint
from sextant.runs.directory import RunDirectory, all_runs


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    return outputs, RunDirectory(execute(quick_config(outputs, "tracking=none", "trainer.max_epochs=8")).directory)


def evaluated(outputs, *arguments):
    evaluate.main([*arguments, f"paths.outputs={outputs}", "tracking=none"])
    newest = max(outputs.glob("runs/evaluation/*/metrics.json"), key=lambda path: path.stat().st_mtime_ns)
    return json.loads(newest.read_text())["metrics"]


def test_evaluation_repeats_the_test_of_training(trained):
    outputs, run = trained
    expected = {k: v for k, v in run.results()["metrics"].items() if k.startswith("test/")}
    assert evaluated(outputs, f"run={run.path}") == expected


@pytest.mark.slow
def test_under_other_corruptions(trained):
    outputs, run = trained
    metrics = evaluated(
        outputs, f"run={run.path.name}", "corruption=gaussian", "corruption.corruptions.gaussian.levels=[0.2,0.4]"
    )
    accuracies = [name for name in metrics if name.startswith("test/accuracy/")]
    assert accuracies == ["test/accuracy/clean", "test/accuracy/gaussian/0.2", "test/accuracy/gaussian/0.4"]


def test_from_a_lone_checkpoint(trained, tmp_path):
    outputs, run = trained
    shutil.copy(run.last_checkpoint, tmp_path / "model.ckpt")
    metrics = evaluated(outputs, f"run={tmp_path / 'model.ckpt'}", "corruption=none")
    of_clean = ("test/accuracy/clean", "test/ece/clean", "test/nll/clean")
    assert metrics == {name: run.results()["metrics"][name] for name in of_clean}


@pytest.mark.slow
def test_a_relative_folder_is_found_from_elsewhere(tmp_path, monkeypatch):
    """And only in the evaluation is it absolute: a run is identified by its folder as it was written."""
    (tmp_path / "there").mkdir()
    (tmp_path / "elsewhere").mkdir()
    for number in range(60):
        (tmp_path / "there" / "photos" / str(number % 2)).mkdir(parents=True, exist_ok=True)
        pixels = np.random.default_rng(number).integers(0, 256, (32, 32), dtype=np.uint8)
        Image.fromarray(pixels).save(tmp_path / "there" / "photos" / str(number % 2) / f"{number}.png")
    monkeypatch.chdir(tmp_path / "there")
    small = ["dataset=image_folder", "dataset.folder=photos", "dataset.size=32", "trainer.max_epochs=1"]
    run = RunDirectory(execute(quick_config(tmp_path, *small, "trainer.batch_size=8", "tracking=none")).directory)
    assert load_checkpoint(run.last_checkpoint)[KEY]["config"]["dataset"]["folder"] == "photos"
    monkeypatch.chdir(tmp_path / "elsewhere")
    expected = {k: v for k, v in run.results()["metrics"].items() if k.startswith("test/")}
    assert evaluated(tmp_path, f"run={run.path}") == expected


def told(*arguments):
    with pytest.raises(UserError) as caught:
        evaluate.main(list(arguments))
    return str(caught.value)


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["dataset=digits", "dataset.size=32"], "the model was trained on 1x28x28"),
        (["backbone=lenet_b"], "belongs to the trained weights"),
        (["corruptoin=none"], "Did you mean corruption?"),
        (["corruption=nope"], "Options: cifar100_c, cifar10_c, cifar10_c_noise, cifar10_p"),
        (["trainer.threds=2"], "Did you mean trainer.threads"),
        (["trainer.threads=0"], "trainer.threads=0"),
    ],
)
def test_mistakes(trained, overrides, said):
    outputs, run = trained
    assert said in told(f"run={run.path}", *overrides, f"paths.outputs={outputs}", "tracking=none")


def test_further_loggers(trained, monkeypatch):
    from sextant.tracking import further_loggers

    outputs, run = trained
    evaluated(outputs, f"run={run.path}", "corruption=none", "tracking.also=[csv]", "trainer.eval_batch_size=7")
    (table,) = outputs.glob("runs/evaluation/*/csv/metrics.csv")
    assert "test/accuracy/clean" in table.read_text().splitlines()[0]
    monkeypatch.setattr(further_loggers, "find_spec", lambda package: None)
    said = told(f"run={run.path}", "tracking.also=[wandb]", f"paths.outputs={outputs}", "tracking=none")
    assert "tracking.also=[wandb] needs wandb, which is not installed" in said


def test_a_run_is_found_by_the_name_it_is_listed_with(trained):
    outputs, run = trained
    assert evaluated(outputs, f"run=classification/{run.path.name}", "corruption=none")


def test_a_checkpoint_that_names_foreign_code_is_not_built(trained, tmp_path):
    outputs, run = trained
    content = load_checkpoint(run.last_checkpoint)
    target = tmp_path / "written"
    content[KEY]["config"]["inhibition"] = {
        "_target_": "pathlib.Path.write_text",
        "self": {"_target_": "pathlib.Path", "_args_": [str(target)]},
        "data": "x",
    }
    torch.save(content, tmp_path / "foreign.ckpt")
    arguments = [f"run={tmp_path / 'foreign.ckpt'}", f"paths.outputs={outputs}", "tracking=none"]
    assert "names import paths outside Sextant" in told(*arguments)
    with pytest.raises(UserError, match="names import paths outside Sextant"):
        predict.main([arguments[0], f"input={run.figures}", f"output={tmp_path / 'out'}", f"outputs={outputs}"])
    assert not target.exists()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["predict", "evaluate"])
def test_a_damaged_checkpoint_is_not_used(trained, tmp_path, command):
    outputs, run = trained
    whole, damaged = run.last_checkpoint.read_bytes(), tmp_path / "last.ckpt"
    chosen = random.Random(0).sample(range(len(whole)), 200)
    damaged.write_bytes(bytes(byte ^ 255 * (i in set(chosen)) for i, byte in enumerate(whole)))
    broken = load_checkpoint(run.last_checkpoint)
    broken["state_dict"] = {name: tensor * torch.nan for name, tensor in broken["state_dict"].items()}
    torch.save(broken, tmp_path / "nan.ckpt")
    for path, said in ((damaged, "is damaged"), (tmp_path / "nan.ckpt", "holds weights that are not finite")):
        if command == "predict":
            arguments = [f"input={run.figures}", f"output={tmp_path / 'out'}", f"outputs={outputs}"]
        else:
            arguments = [f"paths.outputs={outputs}", "tracking=none"]
        with pytest.raises(UserError, match=said) as caught:
            {"predict": predict, "evaluate": evaluate}[command].main([f"run={path}", *arguments])
        assert str(path) in caught.value.problem
        assert caught.value.fix


def test_weights_so_large_that_answers_are_nan(trained, tmp_path):
    _, run = trained
    content = load_checkpoint(run.last_checkpoint)
    content["state_dict"] = {name: torch.full_like(tensor, 1e38) for name, tensor in content["state_dict"].items()}
    torch.save(content, tmp_path / "large.ckpt")
    with pytest.raises(UserError, match=r"large\.ckpt returns NaN"):
        predict.main([f"run={tmp_path / 'large.ckpt'}", f"input={run.figures}", f"output={tmp_path / 'out'}"])


@pytest.mark.slow
def test_a_run_is_not_resumed_from_a_damaged_checkpoint(tmp_path, monkeypatch):
    raw = quick_config(tmp_path, "tracking=none")
    monkeypatch.setattr("sextant.lifecycle.training._test", lambda *given: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        execute(raw)
    (directory,) = all_runs(tmp_path)
    with directory.last_checkpoint.open("r+b") as file:
        file.seek(directory.last_checkpoint.stat().st_size // 2)
        file.write(b"damage")
    monkeypatch.undo()
    with pytest.raises(UserError, match=r"last\.ckpt is damaged") as caught:
        execute(raw)
    assert "recreated by training" in caught.value.fix
    directory.last_checkpoint.unlink()
    execute(raw)
    assert directory.results() is not None


def test_a_gpu_that_is_not_there(trained):
    outputs, run = trained
    if not torch.cuda.is_available():
        assert "no CUDA device" in told(f"run={run.path}", "trainer=gpu", f"paths.outputs={outputs}", "tracking=none")


def test_unknown_and_missing_run(trained):
    outputs, run = trained
    assert f"classification/{run.path.name}" in told("run=nope", f"paths.outputs={outputs}")
    assert "run= is missing" in told()


def test_a_checkpoint_of_another_task(trained, tmp_path):
    outputs, run = trained
    content = load_checkpoint(run.last_checkpoint)
    content[KEY]["task"] = "calibration"
    torch.save(content, tmp_path / "other.ckpt")
    assert "is a calibration model" in told(f"run={tmp_path / 'other.ckpt'}", f"paths.outputs={outputs}")


def test_an_evaluation_is_a_run_of_its_own(trained):
    outputs, run = trained
    evaluated(outputs, f"run={run.path}")
    assert {directory.path.parent.name for directory in all_runs(outputs)} == {"classification", "evaluation"}


def test_predict_classifies_a_folder_and_names_what_it_cannot_read(trained, tmp_path):
    outputs, run = trained
    data = Digits().read("test")
    (tmp_path / "in").mkdir()
    for number in range(12):
        Image.fromarray(data.images[number, 0]).save(tmp_path / "in" / f"{number:02}.png")
    (tmp_path / "in" / "broken.png").write_bytes(b"no image")
    predict.main([f"run={run.path}", f"input={tmp_path / 'in'}", f"output={tmp_path / 'out'}", f"outputs={outputs}"])
    rows = json.loads((tmp_path / "out" / "predictions.json").read_text())
    with np.load(run.arrays) as arrays:
        assert [int(row["class"]) for row in rows[:12]] == arrays["clean"][:12].tolist()
    assert "cannot be decoded (8 bytes): it is text" in rows[12]["error"]
    assert (tmp_path / "out" / "predictions.csv").read_text().startswith("file,class,probability,error\n")
    assert (tmp_path / "out" / "predictions.png").stat().st_size > 1000


def test_predict_without_images(trained, tmp_path):
    outputs, run = trained
    with pytest.raises(UserError, match="no photo there"):
        predict.main([f"run={run.path}", f"input={tmp_path}", f"output={tmp_path / 'out'}", f"outputs={outputs}"])


@pytest.mark.slow
def test_stored_corruptions_give_the_figures_of_drawn_ones(trained, tmp_path):
    from sextant.cli import corruptions_make

    outputs, run = trained
    chosen = "names=gaussian_noise,contrast"
    corruptions_make.main(["make", "set=cifar10_c", "input=digits", f"output={tmp_path / 'stored'}", chosen])
    names = "corruption.names=[gaussian_noise,contrast]"
    drawn = evaluated(outputs, f"run={run.path}", "corruption=cifar10_c", names)
    stored = evaluated(
        outputs, f"run={run.path}", "corruption=files", f"corruption.folder={tmp_path / 'stored'}", names
    )
    assert stored == pytest.approx(drawn, abs=1e-6)
    assert "corruption.folder" in told(f"run={run.path}", "corruption=files", f"paths.outputs={outputs}")


def test_every_kth_test_image(trained):
    outputs, run = trained
    evaluated(outputs, f"run={run.path}", "corruption=gaussian", "task.test_every=7")
    newest = max(outputs.glob("runs/evaluation/*/predictions.npz"), key=lambda path: path.stat().st_mtime_ns)
    with np.load(newest) as some, np.load(run.arrays) as every:
        assert np.array_equal(some["labels"], every["labels"][::7])
        assert np.array_equal(some["clean"], every["clean"][::7])


def test_what_a_test_leaves_beside_its_metrics(trained):
    _, run = trained
    cost = run.results()["cost"]
    assert cost["multiplications"] > 0
    assert cost["inhibition"] == {}
