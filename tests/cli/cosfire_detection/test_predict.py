"""What one example shows is found, told and drawn; what cannot be used is named."""

import csv
import json
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from cli.cosfire_detection.drawn import drawn
from PIL import Image
from support import as_published, fill_disk

from sextant.chapters.cosfire.images import UprightImage
from sextant.chapters.cosfire.network_image import TrainedFeatures, trained_features
from sextant.chapters.cosfire.options import read_inputs
from sextant.chapters.cosfire.predict import filter_facts, predict_detections
from sextant.cli import predict
from sextant.errors import UserError
from sextant.layers.cosfire import Tolerance
from sextant.models import FeatureMap, PlaceNet, ResNetCifar
from sextant.models.pooling import GeM


@pytest.fixture
def example(tmp_path):
    return drawn(tmp_path / "example.png")


def detect(example, images, output, **options):
    chosen = [f"{key}={value}" for key, value in options.items()]
    predict.main(["task=cosfire", f"prototype={example}", f"input={images}", f"output={output}", *chosen])
    return json.loads((output / "detections.json").read_text())


def places(row):
    return [(found["x"], found["y"]) for found in row["detections"]]


@pytest.mark.slow
def test_the_example_is_found_where_it_is_and_nothing_else(tmp_path, example, capsys):
    images = tmp_path / "images"
    drawn(images / "two.png", (300, 200), glyphs=((80, 70), (200, 110)), discs=((260, 40),))
    drawn(images / "none.png", glyphs=(), discs=((60, 60), (150, 90)))
    (images / "broken.jpg").write_bytes(b"nothing")
    out = tmp_path / "out"
    told = detect(example, images, out)
    broken, none, two = told["images"]  # by name
    assert "broken.jpg cannot be decoded" in broken["error"]
    assert none["detections"] == []
    assert 0 < none["strongest"] < 0.7
    assert sorted(places(two)) == [pytest.approx((80, 70), abs=2), pytest.approx((200, 110), abs=2)]
    # the same pixels around it as in the example, so the same response
    assert [found["score"] for found in two["detections"]] == pytest.approx([1, 1], abs=1e-3)
    assert (told["filter"]["preset"], told["filter"]["x"], told["filter"]["y"]) == ("photo", 110, 80)
    lines = list(csv.DictReader((out / "detections.csv").open()))
    assert [line["file"].rsplit("/", 1)[1] for line in lines] == ["broken.jpg", "two.png", "two.png"]
    assert [(float(line["x"]), float(line["y"])) for line in lines[1:]] == places(two)
    assert lines[0]["error"]
    assert list(lines[0]) == ["file", "x", "y", "score", "error"]
    assert {path.name for path in out.glob("*.png")} == {"filter_overlay.png", "none_overlay.png", "two_overlay.png"}
    said = capsys.readouterr().out
    assert "2 detections in 2 images, 1 failed" in said
    assert str(out / "detections.csv") in said.replace("\n", "")


@pytest.mark.slow
def test_the_pictures_are_no_inputs_of_the_next_command(tmp_path, example):
    for _ in range(2):
        told = detect(example, tmp_path, tmp_path / "found")
    assert [row["file"] for row in told["images"]] == [str(example)]


@pytest.mark.slow
def test_turned_and_mirrored_examples_are_found_if_that_is_asked_for(tmp_path, example):
    upright = Image.open(drawn(tmp_path / "a" / "upright.png", glyphs=((90, 70),)))
    upright.transpose(Image.Transpose.ROTATE_90).save(tmp_path / "a" / "turned.png")
    upright.transpose(Image.Transpose.FLIP_LEFT_RIGHT).save(tmp_path / "a" / "mirrored.png")
    plain = detect(example, tmp_path / "a", tmp_path / "plain")
    assert [len(row["detections"]) for row in plain["images"]] == [0, 0, 1]
    assert "scale" not in plain["images"][2]["detections"][0]
    told = detect(example, tmp_path / "a", tmp_path / "out", rotations=4, reflection="true")
    mirrored, turned, whole = (row["detections"][0] for row in told["images"])
    width = 220
    assert (mirrored["x"], mirrored["y"]) == pytest.approx((width - 1 - 90, 70), abs=1)
    assert (turned["x"], turned["y"]) == pytest.approx((70, width - 1 - 90), abs=1)  # counter-clockwise
    assert [(f["rotation_deg"], f["mirrored"]) for f in (mirrored, turned, whole)] == [
        (0, True),
        (90, False),
        (0, False),
    ]
    assert min(f["score"] for f in (mirrored, turned, whole)) > 0.95
    header = (tmp_path / "out" / "detections.csv").read_text().splitlines()[0]
    assert header == "file,x,y,score,rotation_deg,scale,mirrored,error"


@pytest.mark.slow
def test_sizes_are_found_if_that_is_asked_for(tmp_path, example):
    large = Image.open(example).resize((330, 240), Image.Resampling.BICUBIC)
    large.save(tmp_path / "large.png")
    assert detect(example, tmp_path / "large.png", tmp_path / "out")["images"][0]["detections"] == []
    (row,) = detect(example, tmp_path / "large.png", tmp_path / "out", scales="1.5", threshold=0.6)["images"]
    found = row["detections"][0]
    assert (found["x"], found["y"]) == pytest.approx((165.5, 120.5), abs=3)
    assert found["scale"] == 1.5


@pytest.mark.slow
def test_places_are_told_in_pixels_of_the_upright_original(tmp_path, example):
    exif = Image.Exif()
    exif[0x0112] = 6  # stored lying on its side
    whole = Image.open(drawn(tmp_path / "whole.png", (440, 320), glyphs=((220, 160),)))
    lying = whole.transpose(Image.Transpose.ROTATE_90)
    lying.save(tmp_path / "lying.png", exif=exif)
    (row,) = detect(tmp_path / "lying.png", tmp_path / "lying.png", tmp_path / "out", longest=220)["images"]
    assert (row["width"], row["height"]) == (440, 320)
    assert places(row)[0] == pytest.approx((220.5, 160.5), abs=4)
    small = detect(tmp_path / "lying.png", tmp_path / "lying.png", tmp_path / "out", longest=220, point="236,160")
    assert places(small["images"][0])[0] == pytest.approx((236, 160), abs=4)
    with pytest.raises(UserError, match="outside the prototype of 440x320"):
        detect(tmp_path / "lying.png", tmp_path / "lying.png", tmp_path / "out", point="300,320")


def test_the_point_is_told_in_the_original_whose_sides_shrank_unequally():
    image = UprightImage("photo", np.zeros((80, 110, 3), np.uint8), 220, 161)
    example = SimpleNamespace(image=image, point=image.at((100, 150)), parts=3, own=1.0)
    facts = filter_facts(SimpleNamespace(examples=[example], filters=SimpleNamespace(tolerance=Tolerance())), {})
    assert (facts["x"], facts["y"]) == (100, 150)


def test_other_sizes_by_shrinking_are_told_of(tmp_path, example, capsys):
    drawn(tmp_path / "large.png", (660, 480), glyphs=((300, 200),))
    detect(example, tmp_path / "large.png", tmp_path / "out", longest=220)
    assert "1 image was shrunk to longest=220 by another factor" in " ".join(capsys.readouterr().out.split())


def test_images_without_room_for_the_filter_are_told_of(tmp_path, example, capsys):
    Image.open(example).crop((92, 62, 128, 98)).save(tmp_path / "crop.png")
    (row,) = detect(example, tmp_path / "crop.png", tmp_path / "out")["images"]
    assert (row["detections"], row["remark"]) == ([], "smaller than the filter")
    assert "1 image is smaller than the filter" in capsys.readouterr().out


@pytest.mark.slow
def test_the_strongest_are_kept_and_neighbours_are_one(tmp_path, example):
    drawn(tmp_path / "many.png", (700, 160), glyphs=[(80 + 110 * k, 80) for k in range(5)])
    assert len(detect(example, tmp_path / "many.png", tmp_path / "out")["images"][0]["detections"]) == 5
    chosen = {"max_detections": 2}
    assert len(detect(example, tmp_path / "many.png", tmp_path / "out", **chosen)["images"][0]["detections"]) == 2
    wide = {"min_distance": 1000}
    assert len(detect(example, tmp_path / "many.png", tmp_path / "out", **wide)["images"][0]["detections"]) == 1


def test_digits_of_a_few_pixels_are_images_too(tmp_path):
    from sklearn.datasets import load_digits

    seven = load_digits().images[7] * (255 / 16)
    path = tmp_path / "seven.png"
    Image.fromarray(seven.astype("uint8")).resize((28, 28), Image.Resampling.BICUBIC).save(path)
    (row,) = detect(path, path, tmp_path / "out", preset="digit")["images"]
    assert places(row)[0] == pytest.approx((14, 14), abs=2)
    assert row["detections"][0]["score"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["bifurcation", "symbol", "traffic_sign"])
def test_presets_answer_to_their_own_example(tmp_path, preset):
    example = drawn(tmp_path / "example.png", (140, 120), glyphs=((70, 60),))
    told = detect(example, example, tmp_path / "out", preset=preset, point="70,64", rotations=2, scales="1")
    assert told["images"][0]["strongest"] >= 1
    assert told["filter"]["preset"] == preset
    assert told["filter"]["parts"] > 1


@pytest.mark.parametrize(
    ("point", "says"), [("5,150", "nothing in the prototype's neighbourhood"), ("110,80", "has a single colour")]
)
def test_a_prototype_without_structure_is_refused(tmp_path, example, point, says):
    if "colour" in says:
        Image.new("RGB", (220, 160), "teal").save(example)
    with pytest.raises(UserError, match=f"example.png.*{says}"):
        detect(example, example, tmp_path / "out", point=point, preset="digit")
    assert not (tmp_path / "out" / "detections.json").exists()


@pytest.mark.slow
def test_if_no_image_can_be_used_the_command_fails_and_the_files_say_why(tmp_path, example):
    broken = tmp_path / "broken.png"
    broken.write_bytes(b"")
    with pytest.raises(UserError, match=r"(?s)none of 1 image could be used.*broken.png: is empty .0 bytes"):
        detect(example, broken, tmp_path / "out")
    assert "error" in json.loads((tmp_path / "out" / "detections.json").read_text())["images"][0]
    with pytest.raises(UserError, match="0 bytes"):
        detect(broken, example, tmp_path / "out")


@pytest.mark.slow
def test_a_full_disk_is_told(tmp_path, example, monkeypatch):
    fill_disk(monkeypatch, "detections.csv")
    with pytest.raises(UserError, match="the disk is full"):
        detect(example, example, tmp_path / "out")


def inputs_of(example, images, output, **options):
    return read_inputs({"prototype": str(example), "input": str(images), "output": str(output), **options})


@pytest.mark.slow
def test_features_of_a_network_find_the_example_in_images_of_any_size(tmp_path, example):
    torch.manual_seed(0)
    network = torch.nn.Sequential(
        torch.nn.Conv2d(3, 12, 5, 2, 2), torch.nn.ReLU(), torch.nn.Conv2d(12, 24, 3, 2, 1), torch.nn.ReLU()
    )
    large = drawn(tmp_path / "large.png", (320, 240), glyphs=((210, 120),), discs=((70, 70),))
    features = TrainedFeatures(network.eval(), 24, 3, {"run": "x", "layer": "3"})
    (row,) = predict_detections(inputs_of(example, large, tmp_path / "out"), features)
    best = row["detections"][0]
    assert (best["x"], best["y"]) == pytest.approx((211.5, 121.5), abs=4)  # a cell has four pixels
    assert best["score"] == pytest.approx(1, abs=0.05)
    told = json.loads((tmp_path / "out" / "detections.json").read_text())
    assert told["threshold"] == 0.8
    assert (told["filter"]["run"], told["filter"]["layer"]) == ("x", "3")
    # moved examples are configured from anew, for a network knows no rotation of its channels
    turned = tmp_path / "turned.png"
    Image.open(large).transpose(Image.Transpose.ROTATE_90).save(turned)
    (row,) = predict_detections(inputs_of(example, turned, tmp_path / "out", rotations="4"), features)
    best = row["detections"][0]
    assert (best["x"], best["y"], best["rotation_deg"]) == pytest.approx((120, 319 - 210, 90), abs=5)


@pytest.mark.slow
def test_an_image_that_a_network_cannot_take_is_named(tmp_path, example):
    tiny = tmp_path / "tiny.png"
    Image.new("L", (9, 9), 5).save(tiny)
    features = TrainedFeatures(torch.nn.Conv2d(1, 4, 16), 4, 1, {})
    rows = predict_detections(inputs_of(example, f"{tmp_path}/*.png", tmp_path / "out"), features)
    assert ["error" in row for row in rows] == [False, True]


@pytest.fixture
def trained(tmp_path):
    torch.manual_seed(3)
    return as_published(ResNetCifar(3, (32, 32), 10), tmp_path / "resnet20.pth.tar")


def test_a_trained_run_gives_the_features_of_a_layer(tmp_path, trained):
    names = [name for name, _ in ResNetCifar(3, (32, 32), 10).named_children()]
    layer = names[2]
    found = trained_features(str(trained), tmp_path, layer, trust=False)
    with torch.no_grad():
        maps = found.features(torch.rand(1, 3, 40, 56))
    assert maps.shape[1] == found.size
    assert (found.channels, found.facts["layer"], found.facts["task"]) == (3, layer, "classification")
    with pytest.raises(UserError, match="layer='conv9' is not a layer") as caught:
        trained_features(str(trained), tmp_path, "conv9", trust=False)
    assert names[0] in caught.value.fix


def test_of_a_run_of_places_the_backbone_is_looked_at(tmp_path, trained, monkeypatch):
    from sextant.chapters.cosfire import network_image as network

    torch.manual_seed(1)
    backbone = FeatureMap(ResNetCifar(3, (32, 32), 10), 3, (32, 32), layer="layer2")
    model = PlaceNet(backbone, GeM(backbone.channels, backbone.size), 16).eval()
    content = {network.KEY: {"task": "place_recognition", "spec": {"channels": 3, "height": 32, "width": 32}}}
    monkeypatch.setattr(network, "read_trained", lambda path: content)
    monkeypatch.setattr(network, "own_config", lambda *given, **trust: None)
    monkeypatch.setattr(network, "trained_network", lambda *given: model)
    images = torch.rand(2, 3, 32, 48)
    found = trained_features(str(trained), tmp_path, None, trust=False)
    assert (found.facts["layer"], found.size) == ("layer2", backbone.channels)
    with torch.no_grad():
        torch.testing.assert_close(found.features(images), model.feature_map(images))
        earlier = trained_features(str(trained), tmp_path, "layer1", trust=False)
        assert earlier.features(images).shape == (2, earlier.size, 32, 48)


def test_a_run_of_another_task_is_refused(tmp_path, trained, monkeypatch):
    from sextant.chapters.cosfire import network_image as network

    monkeypatch.setattr(network, "read_trained", lambda path: {network.KEY: {"task": "calibration"}})
    with pytest.raises(UserError, match="is a model of calibration; features are taken from classification or"):
        trained_features(str(trained), tmp_path, None, trust=False)


@pytest.mark.slow
def test_the_command_line_does_the_same(tmp_path, example):
    arguments = ["task=cosfire", f"prototype={example}", f"input={example}", f"output={tmp_path / 'out'}"]
    code = "import sys; from sextant.cli import run; run('predict', sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert re.search(r"1 detection in 1 image", done.stdout)
