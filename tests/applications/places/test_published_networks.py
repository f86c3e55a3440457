"""Files of published place networks wherever a run is taken; random weights in the published layouts, no real ones."""

import numpy as np
import pytest
import torch
from models.published_places import FILES
from safetensors.torch import save_file
from support import Payload
from tiny_places import ride

from sextant import Localizer, PhotoCalibrator, PlaceMap
from sextant.cli.predict import main as predict
from sextant.errors import UserError
from sextant.lifecycle.evaluation import evaluate_run
from sextant.runs.directory import RunDirectory


@pytest.fixture(scope="module")
def arrays():
    torch.manual_seed(0)
    return FILES["mixvpr"][0]()


@pytest.fixture(scope="module")
def file(arrays, tmp_path_factory):
    """A Lightning checkpoint, as MixVPR's authors save it."""
    path = tmp_path_factory.mktemp("theirs") / "resnet50_MixVPR_4096.ckpt"
    torch.save({"epoch": 3, "state_dict": arrays}, path)
    return path


def test_a_map_keeps_the_network_with_its_card(file, arrays, tmp_path):
    day = ride(tmp_path / "day", range(2))
    places = PlaceMap.load(file)
    places.add(day)
    found = places.look_up(day / "001.png")
    assert found.best.photo.name == "001.png"
    assert (found.found, found.best.confidence) == (None, None)  # no temperature was fitted to their network
    assert "not of Sextant" in places.temperature.lacking
    places.save(tmp_path / "map")
    again = PlaceMap.open(tmp_path / "map")
    assert again.descriptor.facts["card"]["kind"] == "MixVPR"
    assert again.look_up(day / "001.png").best == found.best
    save_file(arrays, tmp_path / "model.safetensors")
    other = PlaceMap.load(tmp_path / "model.safetensors")
    other.add(day)
    np.testing.assert_array_equal(other.described.index.references.rows, places.described.index.references.rows)


def test_predictions_print_the_card(file, tmp_path, capsys):
    day, night = ride(tmp_path / "day", range(2)), ride(tmp_path / "night", range(1), night=True)
    predict([f"run={file}", f"map={day}", f"queries={night}", f"output={tmp_path / 'out'}"])
    told = " ".join(capsys.readouterr().out.split())
    assert "MixVPR, 4,096 numbers, images of 320x320 with ImageNet's mean and deviation" in told
    assert "not supplied by Sextant" in told


def test_a_localizer_takes_a_file(file, tmp_path):
    images = np.random.default_rng(0).integers(0, 255, (3, 320, 320, 3), dtype=np.uint8)
    poses = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
    localizer = Localizer.from_images(images, poses, descriptor=file)
    assert localizer.descriptor.facts["card"]["dimension"] == 4096


@pytest.mark.slow
def test_an_evaluation_tests_their_network(file, tmp_path):
    for name in ("day", "night"):
        ride(tmp_path / name, range(3), night=name == "night")
    words = [
        "dataset=place_folders", f"dataset.folder={tmp_path}", "dataset.test={map: day, queries: night}",
        "dataset.places=order", "dataset.height=320", "dataset.width=320", "tracking=none",
        f"paths.outputs={tmp_path / 'outputs'}",
    ]  # fmt: skip
    with pytest.raises(UserError, match="local=trunk: the activations of PublishedPlaceNet are not read"):
        evaluate_run(str(file), [*words, "task.rerank=2", "local=trunk"])
    outcome = evaluate_run(str(file), words)
    assert outcome.status == "finished"
    assert any(name.startswith("test/") for name in outcome.metrics)
    assert RunDirectory(outcome.directory).results()["cost"]["descriptor_bytes"] == 4 * 4096


def test_other_tasks_and_sizes_say_what_it_is(file, tmp_path):
    with pytest.raises(UserError, match="place_recognition"):
        PhotoCalibrator.load(file)
    for name in ("day", "night"):
        ride(tmp_path / name, range(3), night=name == "night")
    with pytest.raises(UserError, match=r"3x64x96.*3x320x320") as raised:
        evaluate_run(
            str(file),
            ["dataset=place_folders", f"dataset.folder={tmp_path}", "dataset.test={map: day, queries: night}",
             "dataset.places=order", f"paths.outputs={tmp_path / 'outputs'}"],
        )  # fmt: skip
    assert "dataset.height=320" in raised.value.fix


def test_wrong_files_are_refused(file, tmp_path):
    torch.save({"state_dict": Payload(tmp_path / "trap")}, tmp_path / "their.pth")
    with pytest.raises(UserError, match="it would call"):
        PlaceMap.load(tmp_path / "their.pth")
    assert not (tmp_path / "trap").exists()
    torch.save({"a.weight": torch.zeros(3), "b.weight": torch.zeros(3)}, tmp_path / "other.pth")
    with pytest.raises(UserError, match=r"2 arrays \(a.weight, b.weight"):
        PlaceMap.load(tmp_path / "other.pth")
    save_file({"a.weight": torch.zeros(3)}, tmp_path / "other.safetensors")
    with pytest.raises(UserError, match=r"1 arrays .*no card beside it"):
        PlaceMap.load(tmp_path / "other.safetensors")
    (tmp_path / "cut.ckpt").write_bytes(file.read_bytes()[:-1000])
    with pytest.raises(UserError, match=r"cut\.ckpt is damaged"):
        PlaceMap.load(tmp_path / "cut.ckpt")
    broken = {name: value * torch.nan for name, value in torch.load(file)["state_dict"].items()}
    torch.save(broken, tmp_path / "nan.pth")
    with pytest.raises(UserError, match="not finite"):
        PlaceMap.load(tmp_path / "nan.pth")
