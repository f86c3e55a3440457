"""Every task under every other precision of the schema, from its first step to its arrays, table and figures."""

import platform
from typing import get_args

import numpy as np
import pytest
import torch
from calibration_toy import panorama_files
from cli.test_calibration import config as calibration_config
from quick_runs import quick_runs  # noqa: F401
from support import quick_config
from tiny_digits import digits_config
from tiny_office import office_cache, office_config
from tiny_places import place_words, ride

from sextant.composing.compose import compose, to_plain
from sextant.config.schema.training import Trainer
from sextant.config.validate import validate
from sextant.errors import UserError
from sextant.lifecycle.execute import execute
from sextant.lifecycle.run_reporter import RunReporter
from sextant.runs.directory import RunDirectory

PRECISIONS = get_args(Trainer.model_fields["precision"].annotation)
USUAL = "32-true"  # of the runs of all other tests
ON_CPU = [precision for precision in PRECISIONS if precision not in ("16-mixed", USUAL)]


def classification(root, cache, *overrides):
    return quick_config(root / "outputs", "trainer.max_epochs=1", "tracking=none", *overrides)


def calibration(root, cache, *overrides):
    panorama_files(root, 5)
    short = ["trainer.max_epochs=1", "task.geometric_baselines=false", "task.crops_per_panorama.train=4",
             "trainer.batch_size=8"]  # fmt: skip
    return calibration_config(root, root / "outputs", *short, *overrides)


def place_recognition(root, cache, *overrides):
    for number, split in enumerate(("train", "val", "test")):
        for light in ("day", "night"):
            ride(root / split / light, range(100 * number, 100 * number + 8), light == "night")
    short = ["pooling.grid=null", "task.batch_places=4", "task.dimension=16", "task.whitening=null",
             "trainer.max_epochs=1"]  # fmt: skip
    return to_plain(compose(place_words(root, root / "outputs", *short, *overrides)))


def localization(root, cache, *overrides):
    short = ["trainer.max_epochs=1", "task.starts=1", "task.horizon=10", "filter.particles=100"]
    return office_config(cache, root / "outputs", *short, *overrides)


def cosfire(root, cache, *overrides):
    short = ["trainer.max_epochs=1", "task.images=60", "task.test_every=20", "task.prices=[1]"]
    return digits_config(root / "outputs", *short, *overrides)


TASKS = (classification, calibration, place_recognition, localization, cosfire)


@pytest.fixture
def cache():
    return office_cache()


@pytest.mark.slow
@pytest.mark.parametrize("precision", ON_CPU)
@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.__name__)
def test_a_run_ends_with_its_report(tmp_path, cache, task, precision, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX512")  # bfloat16 is computed in anywhere
    raw = task(tmp_path, cache, f"trainer.precision={precision}")
    outcome = execute(raw)
    run = RunDirectory(outcome.directory)
    results = run.results()
    assert results["outcome"] in ("finished", "diverged")  # of one epoch no network learns much
    assert results["precision"] == precision
    assert results["metrics"]
    assert any(run.figures.iterdir())
    with np.load(run.arrays, allow_pickle=False) as arrays:
        assert arrays.files
        assert all(array.dtype.kind != "V" for array in arrays.values())  # which numpy makes of what it does not know


@pytest.mark.slow
def test_a_processor_without_bfloat16_computes_in_float32_and_says_so(tmp_path, cache, monkeypatch):
    monkeypatch.setattr(torch.backends.cpu, "get_cpu_capability", lambda: "AVX2")
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    said = []
    reporter = RunReporter()
    reporter.say = said.append
    outcome = execute(classification(tmp_path, cache, "trainer.precision=bf16-mixed"), reporter=reporter)
    assert RunDirectory(outcome.directory).results()["precision"] == "32-true"
    assert [line for line in said if "trainer.precision=bf16-mixed: this processor has no bfloat16" in line]


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.__name__)
def test_half_precision_of_a_gpu_is_refused_on_the_cpu_before_anything_runs(tmp_path, cache, task):
    assert set(PRECISIONS) == {"16-mixed", USUAL, *ON_CPU}
    with pytest.raises(UserError, match=r"trainer\.precision=16-mixed needs trainer=gpu"):
        validate(task(tmp_path, cache, "trainer.precision=16-mixed"))
