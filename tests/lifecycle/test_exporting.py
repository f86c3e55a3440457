"""Networks of runs as files that other programs run, for every task that has one."""

import errno
import re

import numpy as np
import onnx
import onnxruntime
import pytest
import tiny_calibration
import tiny_places
import torch
from PIL import Image
from support import quick_config
from tiny_digits import digits_run

import sextant
from sextant import cli
from sextant.errors import UserError
from sextant.kit.offers import Exportable, Named
from sextant.kit.trained import read_trained
from sextant.lifecycle import export_formats
from sextant.lifecycle.execute import execute
from sextant.lifecycle.export_formats import TOLERANCE
from sextant.lifecycle.exporting import export_run
from sextant.lifecycle.offered import exportable
from sextant.runs.checkpoint import KEY


@pytest.fixture(scope="module")
def digits(outputs):
    """A run of LeNet with push-pull inhibition."""
    small = ["trainer.max_epochs=1", "tracking=none", "inhibition=push_pull"]
    return execute(quick_config(outputs, *small)).directory


@pytest.fixture(scope="module")
def places(outputs):
    return tiny_places.tiny_checkpoint(outputs / "places" / "checkpoints" / "last.ckpt")


@pytest.fixture(scope="module")
def cameras(outputs):
    return tiny_calibration.tiny_checkpoint(outputs / "cameras" / "checkpoints" / "last.ckpt")


def onnx_says(path, **inputs):
    """What onnxruntime answers."""
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    return session.run(None, {name: np.asarray(value, np.float32) for name, value in inputs.items()})


def torch_says(path, **inputs):
    found = torch.export.load(path).module()(**{name: torch.from_numpy(value) for name, value in inputs.items()})
    return [each.numpy() for each in (found if isinstance(found, tuple) else (found,))]


SAYS = {"onnx": onnx_says, "torch_export": torch_says}


@pytest.mark.slow
@pytest.mark.parametrize("form", SAYS)
def test_a_classifier_says_elsewhere_what_it_says_here(digits, form, tmp_path):
    exported = export_run(str(digits), form, tmp_path)
    pixels = np.random.default_rng(0).integers(0, 256, (5, 28, 28), dtype=np.uint8)
    classifier = sextant.ImageClassifier.load(digits)
    (logits,) = SAYS[form](exported.network, images=pixels[:, None].astype(np.float32) / 255)
    wanted = [list(each.probabilities.values()) for each in classifier.classify_many(list(pixels[..., None]))]
    np.testing.assert_allclose(torch.from_numpy(logits).softmax(1).numpy(), wanted, atol=1e-5)
    assert 0 <= exported.parity <= TOLERANCE


@pytest.mark.slow
def test_inhibition_is_folded_into_convolutions(digits, tmp_path):
    exported = export_run(str(digits), "onnx", tmp_path)
    graph = onnx.load(exported.network).graph
    for each in (*graph.input, *graph.output):
        assert each.type.tensor_type.shape.dim[0].dim_param == "batch"
    operations = [node.op_type for node in graph.node]
    assert operations.count("Conv") == 3  # LeNet's two, and the pull of the first
    assert operations.count("Sub") == 1


@pytest.mark.slow
@pytest.mark.parametrize("form", SAYS)
def test_places_are_described_elsewhere_as_here(places, form, tmp_path):
    exported = export_run(str(places), form, tmp_path)
    files = [tmp_path / f"{number}.png" for number in range(3)]
    for number, file in enumerate(files):
        tiny_places.scene(number).save(file)
    pixels = np.stack([np.asarray(Image.open(file)) for file in files]).transpose(0, 3, 1, 2).astype(np.float32) / 255
    (rows,) = SAYS[form](exported.network, images=np.ascontiguousarray(pixels))
    map_ = sextant.PlaceMap.load(places)
    map_.add(files)
    assert [map_.look_up(file).best.similarity for file in files] == pytest.approx([1.0] * 3, abs=1e-5)
    network = exportable(read_trained(places), places).network
    np.testing.assert_allclose(rows, network(torch.from_numpy(pixels)).numpy(), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("form", SAYS)
def test_cameras_are_found_elsewhere_as_here(cameras, form, tmp_path):
    exported = export_run(str(cameras), form, tmp_path)
    pixels = np.random.default_rng(0).integers(0, 256, (72, 96, 3), dtype=np.uint8)
    small = np.asarray(Image.fromarray(pixels).resize((24, 18), Image.Resampling.NEAREST))
    network = exportable(read_trained(cameras), cameras).network
    images = np.ascontiguousarray(small.transpose(2, 0, 1)[None].astype(np.float32) / 255)
    aspect = np.array([4 / 3], np.float32)
    camera, half = SAYS[form](exported.network, images=images, aspect=aspect)
    wanted, widths = network(torch.from_numpy(images), torch.from_numpy(aspect))
    np.testing.assert_allclose(camera, wanted.numpy(), atol=1e-5)
    np.testing.assert_allclose(half, widths.numpy(), rtol=1e-5)
    seen = sextant.PhotoCalibrator.load(cameras).network.predict(
        torch.from_numpy(small.transpose(2, 0, 1)[None].copy()), torch.from_numpy(aspect)
    )
    np.testing.assert_allclose(camera[0], [float(each) for each in seen.parameters], atol=1e-5)


@pytest.mark.slow
def test_what_filters_look_at_is_exported_and_filters_without_a_network_are_not(tmp_path):
    run = digits_run(tmp_path / "network", "trainer.max_epochs=1", "task.images=60", "task.filters_per_class=1")
    exported = export_run(str(run.path), "onnx", tmp_path / "out")
    content = read_trained(run.last_checkpoint)
    images = np.random.default_rng(0).random((2, 1, 28, 28), dtype=np.float32)
    (features,) = onnx_says(exported.network, images=images)
    wanted = exportable(content, run.last_checkpoint).network(torch.from_numpy(images))
    np.testing.assert_allclose(features, wanted.numpy(), atol=1e-5)
    assert features.min() == 0
    plain = digits_run(tmp_path / "plain", "bank=gabor", "strategy=circles", "~backbone", "trainer.max_epochs=1",
                       "task.images=60", "task.filters_per_class=1", "task.test_every=8")  # fmt: skip
    with pytest.raises(UserError, match="operate on images, not on a network"):
        export_run(str(plain.path), "onnx", tmp_path / "out")


def test_the_file_that_is_compared_has_the_ending_that_torch_asks_for(tmp_path, caplog):
    found = Exportable(Named(torch.nn.Linear(3, 2)), {"images": torch.rand(2, 3)}, {"images": "", "out": ""})
    assert export_formats.write_network(found, "torch_export", tmp_path / "network.pt2") <= TOLERANCE
    assert [path.name for path in tmp_path.iterdir()] == ["network.pt2"]
    assert not [record for record in caplog.records if "pt2" in record.getMessage()]


def test_an_output_that_is_a_file_is_told_before_any_work(tmp_path, capsys):
    (tmp_path / "file").touch()
    for verb, key, words in (
        ("export", "output", ["run=none"]),
        ("report", "html", ["sweep=none"]),
        ("evaluate", "paths.outputs", ["run=none"]),
    ):
        with pytest.raises(SystemExit, match="2"):
            cli.run(verb, [*words, f"{key}={tmp_path / 'file'}"])
        assert re.search(rf"{key}=.*/file .*be written to", capsys.readouterr().err)


def test_a_model_without_a_network_says_so(tmp_path):
    with pytest.raises(UserError, match="task=localization has no network of its own"):
        exportable({KEY: {"task": "localization"}}, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (ModuleNotFoundError("no onnxscript", name="onnxscript"), r"format=onnx needs onnxscript.*\n.*export\]'"),
        (OSError(errno.ENOSPC, "no space"), "output=.*: the disk is full"),
    ],
)
def test_a_missing_extra_or_a_full_disk_is_no_fault_of_the_network(cause, said, digits, tmp_path, monkeypatch):
    def fail(program, found, path):
        path.write_text("half")
        raise cause

    monkeypatch.setattr(export_formats, "_onnx", fail)
    with pytest.raises(UserError, match=said):
        export_run(str(digits), "onnx", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_an_exporter_that_says_nothing_is_named(digits, tmp_path, monkeypatch):
    def fail(*_):
        raise AssertionError

    monkeypatch.setattr(export_formats, "_onnx", fail)
    with pytest.raises(UserError, match="cannot be exported as onnx: AssertionError\n"):
        export_run(str(digits), "onnx", tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(("off", "said"), [(1e-3, r"0\.001"), (float("nan"), "inf")])
def test_a_file_that_answers_otherwise_is_deleted_and_an_earlier_one_is_not(off, said, places, tmp_path, monkeypatch):
    right = export_formats._torch_export

    def wrong(program, path):
        answer = right(program, path)
        return lambda inputs: [each + off for each in answer(inputs)]

    monkeypatch.setattr(export_formats, "_torch_export", wrong)
    earlier = tmp_path / "network.pt2"
    earlier.write_text("earlier")
    with pytest.raises(UserError, match=f"differ from the original's by {said}"):
        export_run(str(places), "torch_export", tmp_path)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("network.pt2", "earlier")]


@pytest.mark.slow
def test_the_command_says_where_everything_is(digits, outputs, capsys):
    cli.run("export", [f"run={digits}", "format=torch_export", f"outputs={outputs}"])
    folder = outputs / "exported" / "classification" / digits.name
    said = capsys.readouterr().out
    assert str(folder / "network.pt2") in said.replace("\n", "")
    card = (folder / "model_card.md").read_text()
    assert "| dataset | Digits |" in card
    assert "`test/accuracy/clean`" in card
    assert "unknown: no other seeds here" in card
    assert "in this order: 0, 1, 2" in card


@pytest.mark.slow
def test_a_card_has_intervals_over_the_seeds_that_are_there(outputs, digits, tmp_path):
    small = ["trainer.max_epochs=1", "tracking=none", "inhibition=push_pull", "seed=1"]
    execute(quick_config(outputs, *small))
    card = export_run(str(digits), "torch_export", tmp_path, outputs).card.read_text()
    assert "of 2 runs that differ in their seeds" in card
    row = next(line for line in card.splitlines() if line.startswith("| `test/accuracy/clean`"))
    _, _, mean, ends = (cell.strip() for cell in row.strip("| ").split("|"))
    low, high = (float(end) for end in ends.strip("[]").split(","))
    assert low <= float(mean) <= high
