"""Descriptors and networks from elsewhere: arrays, files of numpy.save, ONNX files made here."""

import json
import re

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper
from tiny_places import Pixels, ride

from sextant import Localizer, PlaceMap
from sextant.cli.predict import main as predict
from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.exporting import export_run


@pytest.fixture
def rides(tmp_path):
    return ride(tmp_path / "day", range(6)), ride(tmp_path / "night", range(4), night=True)


def described(folder):
    """Rows of pixels, and what they find."""
    places = PlaceMap(Pixels())
    places.add(folder)
    return places, places.described.index.references.rows


def test_arrays_find_what_the_network_finds(rides, tmp_path):
    (own, day), (_, night) = described(rides[0]), described(rides[1])
    np.save(tmp_path / "day.npy", day.astype(np.float64))
    places = PlaceMap.of_descriptors(rides[0], tmp_path / "day.npy")
    found, wanted = places.look_up_descriptors(night), own.look_up_many(sorted(rides[1].iterdir()))
    assert [each.best.photo for each in found] == [each.best.photo for each in wanted]
    assert [each.margin for each in found] == pytest.approx([each.margin for each in wanted], abs=1e-5)
    assert found[0].found is None
    places.save(tmp_path / "map")
    again = PlaceMap.open(tmp_path / "map")
    assert again.look_up_descriptors(night)[2].best == found[2].best
    with pytest.raises(UserError, match="photos cannot be described here"):
        again.look_up(rides[1] / "000.png")
    with pytest.raises(UserError, match="7 numbers per photo, but those of the map have 1152"):
        again.look_up_descriptors(np.ones((2, 7), np.float32))
    more = ride(tmp_path / "more", [8])
    with pytest.raises(UserError, match="7 numbers per photo"):
        again.add(more, descriptors=np.ones((1, 7), np.float32))
    own.add(more, descriptors=described(more)[1])  # of the map's own network
    assert len(own) == 7


def test_files_are_matched_by_the_command_and_written_by_it(rides, tmp_path):
    for name, folder in zip(("day", "night"), rides, strict=True):
        np.save(tmp_path / f"{name}.npy", described(folder)[1])
    files = f"descriptors={tmp_path / 'day.npy'},{tmp_path / 'night.npy'}"
    folders = [f"map={rides[0]}", f"queries={rides[1]}"]
    predict([*folders, files, f"output={tmp_path / 'out'}", "places=name"])
    told = json.loads((tmp_path / "out" / "matches.json").read_text())
    assert told["counts"]["right"] == 4
    assert told["run"]["map"] == str(tmp_path / "day.npy")


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (np.ones((5, 3), np.float32), r"shape \(5, 3\) of float32; 6 rows of floats"),
        (np.ones((6, 3), np.int64), "of int64; 6 rows of floats"),
        (np.ones(6, np.float32), r"shape \(6,\)"),
        (np.array([[1.0, np.nan]] + [[1.0, 2.0]] * 5), "1 of 6 rows is not finite, the first is row 0"),
        (np.array([{"a": 1}] * 6, object), "cannot be read"),
        (np.array(3.0), "a single number"),
    ],
)
def test_wrong_files_of_descriptors_are_named(rides, tmp_path, rows, told, capsys):
    np.save(tmp_path / "day.npy", rows, allow_pickle=True)
    np.save(tmp_path / "night.npy", np.ones((4, 3), np.float32))
    words = [f"map={rides[0]}", f"queries={rides[1]}", f"output={tmp_path / 'out'}"]
    with pytest.raises(UserError, match=rf"descriptors.*day\.npy.*{told}"):
        predict([*words, f"descriptors={tmp_path / 'day.npy'},{tmp_path / 'night.npy'}"])


def test_words_that_do_not_go_together_are_refused(rides, tmp_path):
    words = [f"map={rides[0]}", f"queries={rides[1]}", f"output={tmp_path / 'out'}"]
    with pytest.raises(UserError, match=r"descriptors=a\.npy must be true, false or <map>"):
        predict([*words, "descriptors=a.npy"])
    with pytest.raises(UserError, match=r"run=zoo:places: descriptors=a\.npy,b\.npy are computed elsewhere"):
        predict([*words, "descriptors=a.npy,b.npy", "run=zoo:places"])
    with pytest.raises(UserError, match=r"descriptors: a\.npy cannot be read"):
        predict([*words, "descriptors=a.npy,b.npy"])
    with pytest.raises(UserError, match="run= is missing"):
        predict(words)


def onnx_file(path, *, shape=("batch", 3, 16, 24), output=("batch", 12), input_name="input", axes=(2, 3)):
    """Means of the cells of a grid of 2 x 2, by channel."""
    nodes = [
        helper.make_node("AveragePool", [input_name], ["cells"], kernel_shape=[8, 12], strides=[8, 12]),
        helper.make_node("Flatten", ["cells"], ["descriptors"]),
    ]
    graph = helper.make_graph(
        nodes,
        "cells",
        [helper.make_tensor_value_info(input_name, TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("descriptors", TensorProto.FLOAT, output)],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    path.write_bytes(model.SerializeToString())
    return path


@pytest.mark.parametrize("batch", ["batch", 1])
def test_an_onnx_file_describes_and_is_kept_with_the_map(rides, tmp_path, batch):
    file = onnx_file(tmp_path / "cells.onnx", shape=(batch, 3, 16, 24), output=(batch, 12))
    places = PlaceMap.load(f"onnx:{file}")
    assert (places.size.height, places.size.width) == (16, 24)
    images = np.random.default_rng(0).integers(0, 255, (11, 16, 24, 3), dtype=np.uint8)
    means = images.reshape(11, 2, 8, 2, 12, 3).mean((2, 4)).transpose(0, 3, 1, 2) / 255
    mean, std = (np.array(v)[:, None, None] for v in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225]))
    wanted = ((means - mean) / std).reshape(11, 12)
    np.testing.assert_allclose(places.descriptor.describer.describe(images), wanted, atol=1e-5)
    places.add(rides[0])
    places.save(tmp_path / "map")
    found = places.look_up(rides[1] / "002.png").best
    file.unlink()
    assert PlaceMap.open(tmp_path / "map").look_up(rides[1] / "002.png").best == found
    assert places.descriptor.facts["card"]["kind"] == "ONNX"


def test_an_onnx_file_is_localized_with(tmp_path):
    file = onnx_file(tmp_path / "cells.onnx")
    images = np.random.default_rng(0).integers(0, 255, (3, 16, 24, 3), dtype=np.uint8)
    localizer = Localizer.from_images(images, [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], descriptor=f"onnx:{file}")
    assert localizer.descriptor.facts["card"]["file"] == "cells.onnx"


@pytest.mark.slow
def test_an_onnx_file_is_tested(rides, tmp_path):
    file = onnx_file(tmp_path / "cells.onnx")
    ride(tmp_path / "night", range(6), night=True)
    outcome = evaluate_run(
        str(file),
        ["dataset=place_folders", f"dataset.folder={tmp_path}", "dataset.test={map: day, queries: night}",
         "dataset.places=order", "dataset.height=16", "dataset.width=24", "tracking=none",
         f"paths.outputs={tmp_path / 'outputs'}"],
    )  # fmt: skip
    assert outcome.status == "finished"


@pytest.mark.slow
def test_an_exported_network_describes_as_the_network(tmp_path):
    from tiny_places import tiny_checkpoint

    run = tiny_checkpoint(tmp_path / "last.ckpt")
    exported = export_run(str(run), "onnx", output=tmp_path / "exported")
    images = np.random.default_rng(0).integers(0, 255, (3, 32, 48, 3), dtype=np.uint8)
    ours, theirs = PlaceMap.load(run), PlaceMap.load(exported.network)
    assert theirs.descriptor.facts["card"]["mean"] is None  # images in [0, 1]
    wanted = ours.descriptor.describer.describe(images)
    np.testing.assert_allclose(theirs.descriptor.describer.describe(images), wanted, atol=1e-4)


def test_wrong_onnx_files_are_named(tmp_path):
    with pytest.raises(UserError, match=r"run=onnx:gone\.onnx: gone\.onnx does not exist"):
        PlaceMap.load("onnx:gone.onnx")
    (tmp_path / "text.onnx").write_text("no network")
    with pytest.raises(UserError, match=r"text\.onnx cannot be opened by ONNX Runtime"):
        PlaceMap.load(tmp_path / "text.onnx")
    file = onnx_file(tmp_path / "grey.onnx", shape=("batch", 1, 16, 24))
    with pytest.raises(UserError, match=r"grey\.onnx takes input \['batch', 1, 16, 24\].*one input is needed"):
        PlaceMap.load(file)
    file = onnx_file(tmp_path / "four.onnx", shape=(4, 3, 16, 24), output=(4, 12))
    with pytest.raises(UserError, match="with b open or 1"):
        PlaceMap.load(file)
    model = onnx.load(onnx_file(tmp_path / "map.onnx"))
    del model.graph.node[1:], model.graph.output[:]
    model.graph.output.append(helper.make_tensor_value_info("cells", TensorProto.FLOAT, ("batch", 3, 2, 2)))
    onnx.save(model, tmp_path / "map.onnx")
    with pytest.raises(UserError, match=r"map\.onnx gives cells .*descriptors \(b, d\) are needed"):
        PlaceMap.load(tmp_path / "map.onnx")


def test_files_and_names_of_the_zoo_are_one_table(tmp_path, monkeypatch, capsys):
    from benchmarks import unseen_places
    from benchmarks.place_sets import ImageSet

    file = onnx_file(tmp_path / "cells.onnx")
    sets = []
    for k, family in enumerate(("first", "second")):
        folders = [ride(tmp_path / f"{family}{night}", range(9 * k, 9 * k + 8), night=bool(night)) for night in (0, 1)]
        paths = [sorted(folder.iterdir()) for folder in folders]
        frames = np.arange(8)
        sets.append(ImageSet(f"set {k}", family, *paths, Positives.within_frames(frames, frames, 0)))
    monkeypatch.setattr(unseen_places, "image_sets", lambda data, floors: sets)
    unseen_places.main([f"run=zoo:places,{file},zoo:streets"])
    shown = capsys.readouterr()
    (table,) = re.findall(r"as they are\s*\n(.*?)less the", shown.out, re.DOTALL)
    rows = [line for line in table.splitlines() if "[" in line]
    assert len(rows) == 3  # with an interval for each set
    assert all(row.count("[") == 2 for row in rows)
    assert "ONNX, 12 numbers" in shown.err
