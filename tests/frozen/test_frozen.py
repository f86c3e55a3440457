"""What was frozen stays as it was. What that is, and how it is written anew, freeze.py and freeze_runs.py say."""

import tarfile
from importlib import import_module
from importlib.util import find_spec

import numpy as np
import pytest
from frozen import freeze
from frozen.freeze_runs import ARMS, NAME, TASKS, answers, words_of
from quick_runs import quick_runs  # noqa: F401

import sextant
from sextant.atomic_files import read_json
from sextant.config import digest, validate
from sextant.config.building import named
from sextant.data.rendered.splits import SAME_BYTES, modules_sha256
from sextant.data.worlds.shots import OPTICS
from sextant.runs.directory import all_runs
from sextant.runs.sweep_directory import read_plans

#: parts of the names of metrics that are measured on the machine
MEASURED = ("ms_per", "us_per", "peak_memory", "fit_map_s")
#: beginnings of the names of metrics that depend on the particles drawn
DRAWN = tuple(
    f"test/{name}"
    for name in (
        *("success", "converged", "frames_to_converge", "position_error", "heading_error", "error_of_all", "pose_nll"),
        *("ess", "ate", "rpe", "nees", "coverage"),
    )
)
CONFIGS = freeze.read("configs.json.gz")


@pytest.mark.slow
def test_every_stored_config_has_the_digest_that_it_had_and_no_part_of_an_unknown_class():
    """Of every option; those of sweeps are composed of the same, see below."""
    changed, custom = [], []
    for name, frozen in ((name, frozen) for name, frozen in CONFIGS.items() if not name.startswith("sweep=")):
        config = validate(frozen["config"] | freeze.paths())
        changed += [name] * (digest(config.model_dump(by_alias=True)) != frozen["digest"])
        custom += [name] * bool(config.custom_parts())
    assert (changed, custom) == ([], [])


def test_rendered_datasets_are_found_by_the_hash_that_they_were_stored_with():
    """If the source that renders was meant to change: ``python tests/frozen/renders_as.py <commit before>``."""
    assert modules_sha256("sextant.worlds", "sextant.data.worlds", *OPTICS) == SAME_BYTES[1]


def test_every_option_is_there_still():
    assert {name for name in CONFIGS if not name.startswith("sweep=")} <= {name for name, _ in freeze.choices()}


@pytest.mark.slow
def test_what_was_refused_as_the_value_of_a_key_is_refused():
    differing = {}
    for name, number in freeze.read("wrong.json.gz").items():
        choice, _, key = name.partition(" ")
        plain = CONFIGS[choice]["config"] | freeze.paths()
        if number is not None and not freeze.refuses(plain, tuple(key.split(".")), freeze.WRONG[number]):
            differing[name] = freeze.WRONG[number]
    assert differing == {}


#: internal names that chapters and their kit have replaced
REPLACED = {
    *("sextant.trained", "sextant.recipes.RECIPES", "sextant.recipes.Recipe", "sextant.recipes.Source"),
    "sextant.recipes.recipe_of",
    *(f"sextant.config.schema.{task}Task" for task in ("Calibration", "Classification", "Cosfire", "Localization")),
    "sextant.config.schema.PlaceRecognitionTask",
}


def test_what_was_public_can_be_imported():
    frozen = freeze.read("names.json")
    gone = {
        f"{package}.{name}"
        for package, names in frozen["public"].items()
        for name in names
        if not hasattr(import_module(package), name) and find_spec(f"{package}.{name}") is None
    }
    assert gone == REPLACED


def test_registered_models_of_before_find_what_they_import():
    module = import_module("sextant.recipes.photo_predictors")
    assert module.photo_predictor is import_module("sextant.lifecycle.offered").photo_predictor


def test_every_target_that_a_config_named_is_there():
    frozen = freeze.read("names.json")
    for target in frozen["targets"]:
        assert callable(named(target))


def test_every_argument_has_the_range_that_it_had():
    """That a value outside of it is refused, ``config/test_ranges.py`` tests."""
    found, frozen = freeze.allowed(), freeze.read("ranges.json")
    names = [name for name in found | frozen if found.get(name) != frozen.get(name)]
    assert {name: found.get(name) for name in names} == {name: frozen.get(name) for name in names}


def test_each_verb_prints_the_help_that_it_printed():
    assert freeze.helps() == freeze.read("help.json")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_every_arm_of_a_sweep_composes_to_the_config_that_it_had():
    """What options are composed to, ``configs/test_every_config.py`` compares."""
    found = {name: freeze.of_config(plain) for name, plain in freeze.cells()}
    stored = {name: config for name, config in CONFIGS.items() if name.startswith("sweep=")}
    assert {name for name in stored if found.get(name) != stored[name]} == set()


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    """The frozen files in a folder of their own."""
    root = tmp_path_factory.mktemp("frozen")
    with tarfile.open(freeze.HERE / NAME) as archive:
        archive.extractall(root, filter="data")
    return root


@pytest.fixture(scope="module")
def where(stored):
    return [f"paths.outputs={stored / 'outputs'}", f"paths.cache={stored / 'cache'}"]


def run_of(stored, task):
    """The first run of a task."""
    return next(run for run in all_runs(stored / "outputs") if run.state()["task"] == task)


@pytest.mark.slow
@pytest.mark.parametrize("task", TASKS)
def test_a_stored_run_is_evaluated_to_its_metrics(stored, where, task):
    run = run_of(stored, task)
    words = [word for word in words_of(task, stored / "data") if word.startswith("dataset.folder=")]
    found = sextant.evaluate(run.path, [*words, *where]).metrics
    expected = {key: value for key, value in read_json(run.metrics)["metrics"].items() if key.startswith("test/")}
    assert expected
    differing = {
        key: (found.get(key), value)
        for key, value in expected.items()
        if not any(word in key for word in MEASURED)
        and found.get(key) != pytest.approx(value, rel=1e-4, abs=1e-6, nan_ok=True)
    }
    near = {key: pair for key, pair in differing.items() if key.startswith("test/descriptor_nll")}
    if task == "localization" and near:
        # the map itself differs by this processor's rounding, so that other particles are drawn
        assert all(pair == pytest.approx((pair[1], pair[1]), abs=0.01) for pair in near.values())
        assert found["test/success_0.5m_10deg_10f/summer_noon"] == 1
        drawn = {key for key in differing if key.startswith(DRAWN)}
        assert drawn <= found.keys()
        differing = {key: pair for key, pair in differing.items() if key not in near.keys() | drawn}
    assert differing == {}


@pytest.mark.slow
@pytest.mark.parametrize(
    "task", ["classification", "cosfire", "localization"]
)  # others keep the path of their pictures
def test_a_stored_run_is_a_finished_run_of_its_config(stored, where, task):
    words = [*words_of(task, stored / "data"), *where, "reuse=any_code"]
    outcome = sextant.run(words)
    assert outcome.reused
    assert outcome.directory.parent == stored / "outputs" / "runs" / task


@pytest.mark.slow
def test_a_sweep_goes_on_with_its_finished_cells(stored, where):
    quick = [*words_of("classification", stored / "data"), *ARMS, *where, "reuse=any_code"]
    whole = sextant.sweep(overrides=quick)
    half = sextant.sweep(overrides=[*quick, "optimizer.lr=0.03"])
    reused = [sum(outcome.reused for outcome in sweep.outcomes) for sweep in (whole, half)]
    assert (reused, whole.count("failed") + half.count("failed")) == ([4, 2], 0)
    assert {whole.directory, half.directory} == set(read_plans(stored / "outputs"))
    assert {row["status"] for row in sextant.load_results(whole.directory)} == {"finished"}


@pytest.mark.slow
def test_a_stored_map_and_a_stored_localizer_answer_as_they_did(stored):
    frozen, found = read_json(stored / "answers.json"), answers(stored)
    assert [name for name, _ in found["matches"]] == [name for name, _ in frozen["matches"]]
    similar = [[value for _, value in each["matches"]] for each in (found, frozen)]
    assert similar[0] == pytest.approx(similar[1], abs=1e-5)
    assert np.array(found["poses"]) == pytest.approx(np.array(frozen["poses"]), abs=1e-3)
