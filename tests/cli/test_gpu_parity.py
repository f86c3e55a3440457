"""Every task that can on a GPU as on the CPU: a training step, and the answers of a trained network."""

import numpy as np
import pytest
import torch
from cli.test_precisions import TASKS, cache, localization  # noqa: F401 - a fixture

from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory
from sextant.runs.history import read_history

pytestmark = [pytest.mark.gpu, pytest.mark.slow]
THERE = "gpu"
#: the tasks that compute on a GPU if asked to
ON_GPU = [task for task in TASKS if task is not localization]
#: of answers that are not numbers on a scale, such as labels: how many may differ
FLIPPED = 0.02


@pytest.fixture(autouse=True)
def device():
    if THERE == "gpu" and not torch.cuda.is_available():
        pytest.skip("no CUDA device")


@pytest.fixture(params=ON_GPU, ids=lambda task: task.__name__)
def runs(request, tmp_path, cache):  # noqa: F811
    """The run of a task on the CPU, and its like on the device."""
    found = []
    for number, device in enumerate(("cpu", THERE)):
        folder = tmp_path / str(number)
        folder.mkdir()
        outputs = f"paths.outputs={tmp_path / f'outputs{number}'}"  # not among the photos
        raw = request.param(folder, cache, f"trainer.accelerator={device}", outputs)
        found.append(RunDirectory(execute(raw).directory))
    return found


def first_loss(run):
    losses = (line["metrics"].get("train/loss") for line in read_history(run.history))
    return next((loss for loss in losses if loss is not None), None)


def measured(run):
    """The metrics but how long something took."""
    return {
        name: value for name, value in run.results()["metrics"].items() if "/ms_" not in name and "/us_" not in name
    }


def arrays(directory):
    with np.load(RunDirectory(directory).arrays, allow_pickle=False) as found:
        return {name: found[name] for name in found.files}


def require_alike(found, expected):
    """Numbers agree to a thousandth of their spread, but for a few that tipped over an edge."""
    assert found.keys() == expected.keys()
    for name, wanted in expected.items():
        assert found[name].shape == wanted.shape, name
        if wanted.dtype.kind == "f" and wanted.size:
            spread = np.nanmax(np.abs(np.where(np.isfinite(wanted), wanted, np.nan)), initial=1e-6)
            far = ~np.isclose(found[name], wanted, rtol=1e-2, atol=1e-3 * spread, equal_nan=True)
        else:
            far = found[name] != wanted
        assert np.mean(far) <= FLIPPED, name


def test_it_trains_as_on_the_cpu(runs):
    on_cpu, there = runs
    assert first_loss(there) == pytest.approx(first_loss(on_cpu), rel=1e-2)
    expected, found = measured(on_cpu), measured(there)
    assert found.keys() == expected.keys()
    assert found == pytest.approx(expected, rel=0.15, abs=0.15, nan_ok=True)


def test_a_trained_network_answers_as_on_the_cpu(runs, tmp_path):
    on_cpu, _ = runs
    outputs = f"paths.outputs={tmp_path / 'evaluated'}"
    again = evaluate_run(str(on_cpu.path), [f"trainer.accelerator={THERE}", "tracking=none", outputs])
    require_alike(arrays(again.directory), arrays(on_cpu.path))
