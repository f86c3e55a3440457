"""Commands of README and docs that are run, smaller than they are told, and why the others are not."""

import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from data.places.gps_pictures import add_gps
from data.places.place_pictures import picture
from docs_commands import ROOT, documented
from PIL import Image
from support import QUICK as QUICK_CLASSIFIER
from tiny_digits import PLAIN
from tiny_digits import QUICK as QUICK_FILTERS
from tiny_office import OFFICE
from tiny_office import QUICK as QUICK_LOCALIZER

from sextant import cli

ONCE = ("trainer=fast", *QUICK_CLASSIFIER, "trainer.max_epochs=1", "tracking=none")
FRAMES = (*(each for each in QUICK_LOCALIZER if not each.startswith("descriptor.")), "task.starts=2", "task.horizon=15")
POSES = "dataset.folder=<folder> dataset.map=map 'dataset.test={run: run}'"
PROTOTYPE = "prototype=photo.jpg point=310,190 input=<folder> output=<folder>"
STREET = "docs/worlds/street_01_centre_summer_noon.png"
#: what is run, with what makes it quick, and what it prints; ``<run>`` is the classifier of the first
RUN = {
    "python train.py task=classification inhibition=push_pull": (ONCE, "test/accuracy/clean"),
    "python train.py backbone=lenet_b optimizer.lr=0.01": (ONCE, "test/accuracy/clean"),
    "python train.py dataset=image_folder dataset.folder=/path": ((*ONCE, "trainer.batch_size=4"), "test/accuracy"),
    "python train.py -m seed=0,1,2 inhibition=none,push_pull": (ONCE, "6 planned, "),
    "sextant train -m sweep.search=tpe sweep.search.n_trials=20 'optimizer.lr=log_uniform(1e-3, 1)' "
    "'optimizer.momentum=uniform(0.5, 0.99)' seed=0,1,2": (
        (*ONCE, "sweep.search.n_trials=2"),
        "trial 1: optimizer.lr=",
    ),
    "sextant report sweep=search": ((), "2 of 2 trials"),
    "python evaluate.py run=<run> corruption=gaussian": (
        ("corruption.corruptions.gaussian.levels=[0.1]", "tracking=none"),
        "test/accuracy/gaussian/0.1",
    ),
    "python predict.py run=<run> input=<folder> output=<folder>": ((), "4 images classified"),
    f"python predict.py task=cosfire {PROTOTYPE}": ((), "image"),
    f"python predict.py task=cosfire prototype={STREET} point=190,135 input={STREET} output=<folder>": ((), "image"),
    "python train.py task=cosfire": (QUICK_FILTERS[1:] + PLAIN[3:], "cosfire_svm"),
    "python train.py task=cosfire bank=gabor strategy=circles": (QUICK_FILTERS[1:] + PLAIN[2:], "cosfire_svm"),
    "python train.py inhibition=push_pull corruption=gaussian": (
        tuple(each for each in ONCE if "contrast_poisson" not in each),
        "test/accuracy/gaussian/0.1",
    ),
    "python train.py task=localization 'dataset.size_m=[14, 12]' 'dataset.metres=[40, 8, 16]' dataset.every=4 "
    "task.starts=3": ((*OFFICE, *QUICK_LOCALIZER), "particles"),
    "python train.py task=localization": ((*OFFICE, *QUICK_LOCALIZER), "particles"),
    "python train.py task=localization likelihood.tempering=along_drives": ((*OFFICE, *QUICK_LOCALIZER), "particles"),
    "python train.py task=localization seed=0 dataset.seed=0 filter.apart=2 filter.outliers=0.1": (
        (*OFFICE, *QUICK_LOCALIZER),
        "particles",
    ),
    f"python train.py experiment=localization_folder {POSES}": (FRAMES, "particles"),
    f"python train.py experiment=localization_folder {POSES} dataset.poses=gps dataset.protocol=town": (
        FRAMES,
        "particles",
    ),
    "python train.py --help": ((), "Config groups"),
    "sextant runs": ((), "classification/"),
    "sextant runs delete <task>/<run>": ((), "deleted classification/"),
    "sextant data list": ((), "office_walk"),
    "sextant data posed folder=/tmp/office": ((), "to locate the photos: sextant locate"),
    "sextant locate map=/tmp/office/map input=/tmp/office/photos output=/tmp/office/found "
    "camera=207.18,207.18,159.5,119.5": ((), "images located"),
    "make help": ((), "dashboard"),
}
#: why the others are not: what such a command begins with or holds
NOT_RUN = {
    r"^python train\.py --config-dir": "needs config files of one's own; tests/cli/test_train.py",
    r"^python -m benchmarks": "times an otherwise idle machine for minutes",
    r"^python (train|report)\.py .*sweep=": "a sweep of hours; each arm and value is composed by tests/frozen",
    r"^sextant (train|report) .*sweep=search_": "a search of a quarter of an hour; tests/lifecycle",
    r"^(python train\.py|sextant train) -m ": "eight runs of minutes",
    r"^python train\.py .*(mnist|nordland|cold|cifar10|places|folder|photos|alexnet)": "needs data that is not shipped",
    r"^python train\.py .*descriptor=landmarks": "needs a photo of the map; tests/applications/detection",
    r"^python train\.py .*descriptor=network": "minutes; smaller in tests/trained/test_backbone_layer.py",
    r"^python train\.py .*descriptor=run": "needs a trained run of place recognition; smaller in tests/cli",
    r"^python train\.py (task=(calibration|place_recognition)|experiment=)": "renders towns; smaller in tests/tasks",
    r"^python train\.py .*dataset=town": "renders a town; smaller in tests/data/worlds",
    r"^python evaluate\.py .*(dataset|checkpoint|off_the_shelf|cifar10)": "needs data and a run of it; tests/cli",
    r"^python train\.py trainer\.devices=2": "as tests/lifecycle/test_several_processes.py",
    r"^sextant evaluate run=zoo:": "needs panoramas or MNIST; tests/zoo",
    r"^sextant evaluate model=": "needs a file of others; of random weights in tests/cli/test_evaluate_model.py",
    r"^sextant evaluate run=dino_salad": "needs weights of others; tests/applications/places",
    r"^sextant predict network=": "needs weights of others; of random ones in tests/cli/photo_calibration",
    r"^(\S*python predict\.py|sextant predict) input=": "calibrates photos of one's own; tests/cli/photo_calibration",
    r"^sextant benchmark": "needs photos of known cameras; of drawn ones in tests/cli/test_benchmark.py",
    r"^python predict\.py run=": "needs a trained run of its task; smaller in tests/cli",
    r"^python report\.py sweep=<name>": "as the reports of tests/system/test_sweep.py",
    r"^python -m sextant\.corruptions": "needs CIFAR-10; smaller in tests/corruptions/test_make_command.py",
    r"^sextant (data describe|predict run=)": "needs a trained run of place recognition; tests/applications/places",
    r"^sextant data (render|verify|gallery)": "renders for minutes; smaller in tests/cli/test_data.py",
    r"^sextant claims": "as tests/lifecycle/test_claims.py, or runs sweeps",
    r"^sextant report .*html=": "as tests/reports/test_html_page.py",
    r"^sextant (export|register)": "as tests/lifecycle/test_exporting.py and test_registering.py",
    r"^sextant doctor": "as tests/cli/test_doctor.py and tests/runs/test_machine.py",
    r"^sextant compare": "needs two trained runs; tests/reports/test_run_comparison.py",
    r"^sextant replay": "needs a run that a NaN stopped; tests/lifecycle/test_debugging.py",
    r"^sextant inspect": "needs photos of one's own; tests/applications/inspection, tests/cli/test_inspect.py",
    r"^sextant localize": "needs a map; tests/cli/test_localize.py",
    r"^sextant locate ": "needs posed photos; tests/applications/localization/test_pose_map.py",
    r"^sextant walk": "needs a walk and a map; tests/applications/walks runs it on rendered ones",
    r"^sextant trajectory": "needs two trajectories; tests/cli/test_trajectory.py runs it on files of that kind",
    r"^sextant sweep (status|attach|cancel)": "needs a submitted sweep; tests/lifecycle/test_launchers.py",
    r"^make (setup|run|test|lint|lock|docs|worlds-gallery|gpu-check)": "installs, or takes minutes",
    r"^make gpu-claims": "reads the plans of all claims; tests/cli/test_gpu_claims.py",
    r"^(make|sextant) dashboard": "serves until it is ended; tests/tracking",
    r"^sextant demo": "serves until it is ended; tests/demo",
    r"^source ": "an environment of the user's own",
}
COMMANDS = {command.text: command for command in documented()}


def filled_in(text, folder, run):
    """The words of a command, its placeholders and paths replaced by what the desk has."""
    own = {
        "/path": folder / "classes",
        "/tmp/office": folder / "office",
        "dataset.folder=<folder>": f"dataset.folder={folder / 'drives'}",
        "input=<folder>": f"input={folder / 'photos'}",
        "output=<folder>": f"output={folder / 'found'}",
        "photo.jpg": folder / "photos" / "0.png",
        "<task>/<run>": f"{run.parent.name}/{run.name}",
        "<run>": run,
    }
    for told, path in own.items():
        text = text.replace(told, str(path))
    return shlex.split(text)


def status_of(verb, words):
    """Exit status of a command that is run in this process."""
    try:
        cli.run(verb, words)
    except SystemExit as end:
        return end.code
    return 0


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    """Pictures of two classes, photos with something to find, and two drives along a line."""
    folder = tmp_path_factory.mktemp("docs")
    for name in ("a", "b"):
        (folder / "classes" / name).mkdir(parents=True)
        for k in range(12):
            Image.fromarray(picture(k + 100 * (name == "b"), 32, 32)).save(folder / "classes" / name / f"{k}.png")
    (folder / "photos").mkdir()
    for k in range(4):
        Image.fromarray(picture(k, 60, 80)).resize((400, 300)).save(folder / "photos" / f"{k}.png")
    for name in ("map", "run"):
        (folder / "drives" / name).mkdir(parents=True)
        for k in range(30):
            noise = np.random.default_rng([k, name == "run"]).normal(scale=10, size=(16, 24, 3))
            seen = (0.8 * picture(k).astype(float) + 20 + noise).clip(0, 255).astype(np.uint8)
            Image.fromarray(seen).save(folder / "drives" / name / f"{k:03d}.png")
            add_gps(folder / "drives" / name / f"{k:03d}.png", k + 0.1 * (name == "run"), 0, 0)
        rows = ["file,x,y,heading", *(f"{k:03d}.png,{k + 0.1 * (name == 'run')},0,0" for k in range(30))]
        (folder / "drives" / name / "poses.csv").write_text("\n".join(rows))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SEXTANT_OUTPUTS", str(folder / "outputs"))
        patch.chdir(ROOT)
        yield folder


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_commands_do_what_the_page_says(desk, monkeypatch, capsys):
    run = desk
    for text, (smaller, printed) in RUN.items():
        program, *words = filled_in(text, desk, run)
        if program == "make":
            assert printed in subprocess.run([program, *words], capture_output=True, text=True, check=True).stdout
            continue
        verb, *rest = words if program == "sextant" else [words[0].removesuffix(".py"), *words[1:]]
        monkeypatch.setattr(sys, "argv", [f"{verb}.py"])
        status, told = status_of(verb, [*rest, *smaller]), capsys.readouterr()
        assert not status, f"{text}: {told.err}"
        assert printed in told.out, f"{text}: {told.out}"
        if run == desk:
            (run,) = desk.glob("outputs/runs/classification/[!.]*")


def test_every_command_is_run_or_has_a_reason_not_to_be():
    assert not [text for text in RUN if text not in COMMANDS], "no page tells this any more"
    without = [text for text in COMMANDS if text not in RUN and not any(re.search(each, text) for each in NOT_RUN)]
    assert not without, "run these in RUN, or say in NOT_RUN why not"


@pytest.mark.parametrize("pattern", NOT_RUN)
def test_no_reason_is_left_over(pattern):
    assert any(re.search(pattern, text) for text in COMMANDS if text not in RUN)
