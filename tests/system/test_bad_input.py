"""Each mistake ends with one clear message, exit status 2 and no traceback, before anything heavy is imported."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import sextant
from sextant import cli

ROOT = Path(__file__).parents[2]

MISTAKES = {
    "unknown task": (["task=juggling"], "task=juggling: no such option"),
    "misspelt key": (["trainer.max_epoch=3"], "Did you mean trainer.max_epochs=3?"),
    "misspelt group": (["datset=mnist"], "Did you mean dataset=mnist?"),
    "forced unknown key": (["++trainer.bogus=1"], "trainer.bogus: unknown key"),
    "added unknown key": (["+bogus=1"], "bogus: unknown key"),
    "wrong type": (["trainer.max_epochs=many"], "trainer.max_epochs='many': must be a valid integer"),
    "out of range": (["optimizer.lr=-1"], "optimizer.lr=-1: must be greater than 0. For example optimizer.lr=0.1"),
    "rule across keys": (["optimizer.momentum=0.0"], "optimizer.nesterov=true needs optimizer.momentum above 0"),
    "missing value": (["dataset=image_folder"], "dataset.folder has no default"),
    "missing folder": (["dataset=image_folder", "dataset.folder=/nowhere"], "no such folder. Looked for"),
    "missing dataset": (["dataset=cifar10", "paths.data=/nowhere", "paths.cache=/nowhere/else"], "dataset=digits"),
    "unreachable server": (["tracking=server", "tracking.uri=http://127.0.0.1:9"], "no MLflow server answers there"),
    "no address": (["tracking=server"], "tracking=server tracking.uri=http://127.0.0.1:5000"),
    "unwritable output": (["paths.outputs=/proc/sextant"], "paths.outputs=/proc/sextant cannot be written to"),
    "sweep without -m": (["sweep=demo"], "Run it with -m: sextant train -m sweep=demo"),
    "unknown sweep": (["-m", "sweep=dmeo"], "Did you mean sweep=demo?"),
    "wrong choice in a sweep": (["-m", "seed=0,1", "backbone=lenet_a,lenet_z"], "backbone=lenet_z: no such option"),
    "several values without -m": (["seed=0,1"], "A sweep needs -m: sextant train -m seed=0,1"),
    "range in a sweep": (["-m", "optimizer.lr=interval(0.1,0.2)"], "a sweep lists its values"),
    "seed that is no number": (["-m", "seed=0,x"], "seeds must be different whole numbers"),
    "same seed twice": (["-m", "seed=3,3"], "seeds must be different whole numbers"),
    "no value for a factor": (["-m", "sweep=demo", "sweep.factors.backbone=[]"], "at least 1 item"),
    "key that the arms set": (["-m", "sweep=demo", "inhibition=twin"], "inhibition is what the arms of this sweep"),
    "not an override": (["please train"], "'please train' is not a key=value override"),
    "run of another command": (["run=foo"], "init_from=foo starts training from its weights"),
    "printed config with nan": (["--cfg", "job", "optimizer.lr=nan"], "optimizer.lr=nan: must be a finite number"),
    "printed config with an unknown key": (["++trainer.bogus=1", "-c", "job"], "trainer.bogus: unknown key"),
    "printed config without a value": (["dataset=image_folder", "--cfg=job"], "dataset.folder has no default"),
    "shell as a backbone": (
        ["backbone._target_=os.system"],
        "backbone._target_=os.system: os.system is refused: it runs programs",
    ),
    "missing module": (
        ["backbone._target_=gone.Network"],
        "backbone._target_=gone.Network: gone.Network: no such module",
    ),
    "missing name": (
        ["optimizer._target_=sextant.Gone"],
        "optimizer._target_=sextant.Gone: sextant.Gone: sextant has no Gone",
    ),
    "missing module in a sweep": (["-m", "seed=0,1", "loss._target_=gone.Loss", "task=calibration"], "loss._target_"),
    "nothing to call": (["backbone._target_=math.pi"], "backbone._target_=math.pi is not a class or function"),
    "batch larger than the data": (
        ["trainer.batch_size=1000000"],
        "trainer.batch_size=1000000: dataset=digits has 1,294 images to train on",
    ),
    "crops fewer than a batch": (
        ["task=calibration", "trainer.batch_size=2000", "tracking=none"],
        "trainer.batch_size=2000: dataset=town_panoramas has 1,536 images to train on",
    ),
    "corruptions of places": (
        ["task=place_recognition", "corruption=cifar10_p"],
        "corruption: task=place_recognition draws the corruptions of its images and cannot use sequences",
    ),
    "start from no run": (["init_from=gone"], "init_from=gone: no run, run directory or checkpoint"),
    "descriptor of no run": (
        ["task=cosfire", "descriptor=run:gone"],
        "descriptor.run=gone: no run, run directory",
    ),
    "features of no run": (["task=cosfire", "features=run:gone"], "features.run=gone: no run, run directory"),
    "layer of no run": (
        ["task=place_recognition", "task.off_the_shelf={weights: gone, layer: layer2}"],
        "task.off_the_shelf.weights=gone: no run, run directory",
    ),
}


@pytest.mark.parametrize(("arguments", "said"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_told_in_one_message(arguments, said, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    monkeypatch.setattr(sys, "argv", ["train.py"])
    with pytest.raises(SystemExit) as caught:
        cli.run("train", arguments)
    told = capsys.readouterr().err
    assert caught.value.code == 2
    assert said in told
    assert told.startswith("Error: ")
    assert "Traceback" not in told
    assert not list(tmp_path.glob("runs/*/[!.]*"))  # a lock alone


def run_and_list_modules(arguments, tmp_path):
    code = (
        "import sys; sys.argv[0] = 'train.py'\n"
        "from sextant.cli import run_script\n"
        "try: run_script('train')\n"
        "finally: print('MODULES', *sys.modules, file=sys.stderr)\n"
    )
    line = "python train.py dataset="
    completion = {"COMP_LINE": line, "COMP_POINT": str(len(line))}
    environment = {**os.environ, **completion, "SEXTANT_OUTPUTS": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, cwd=ROOT, env=environment, check=False
    )
    return done, set(done.stderr.rsplit("MODULES", 1)[-1].split())


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["--help"], 0, "Config groups"),
        (["--cfg", "job"], 0, "max_epochs:"),
        (["-sc", "query=bash"], 0, "dataset=mnist"),
        (["optimizer.lr=-1"], 2, "optimizer.lr=-1"),
        (["dataset=mnits"], 2, "dataset=mnist"),
    ],
)
def test_light_paths_import_nothing_heavy(arguments, status, said, tmp_path):
    done, modules = run_and_list_modules(arguments, tmp_path)
    assert done.returncode == status
    assert said in done.stdout + done.stderr
    assert "hydra" in modules
    assert not modules & {"torch", "pytorch_lightning", "mlflow", "torchvision", "sklearn", "matplotlib"}


@pytest.mark.parametrize(
    ("verb", "arguments", "said"),
    [
        ("evaluate", [], "run= is missing"),
        ("evaluate", ["run=nothing"], "There are no trained runs here yet"),
        ("predict", ["run=nothing"], "input= is missing"),
        ("predict", ["run=nothing", "trust=yes"], "trust=yes must be true or false"),
        ("report", ["sweep=demo"], "sweep=demo has not run here"),
        ("report", ["sweep=demo", "tracking=maybe"], "tracking=maybe must be none"),
        ("report", [], "sweep= is missing"),
        ("report", ["sweep=nothing"], "There are no sweeps here yet"),
        ("report", ["swep=demo"], "Did you mean sweep=demo?"),
        ("runs", ["delete", "classification/nothing"], "no such run"),
        ("runs", ["burn"], "not understood"),
        ("frobnicate", [], "sextant frobnicate: no such command"),
        ("trian", [], "Did you mean sextant train?"),
        ("dashboard", ["port=eighty"], "port=eighty must be a whole number"),
    ],
)
def test_mistakes_with_the_other_commands(verb, arguments, said, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path))
    with pytest.raises(SystemExit) as caught:
        cli.run(verb, arguments)
    assert caught.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["train", "--version"])
def test_the_version_is_ours(verb, capsys):
    cli.run(verb, ["--version"])
    assert capsys.readouterr().out == f"sextant {sextant.__version__}\n"
