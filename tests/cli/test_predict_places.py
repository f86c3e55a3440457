"""Photos looked up in a map: with a network trained here, and with a descriptor that is pixels."""

import csv
import json
import shlex
import shutil

import numpy as np
import pytest
from data.places.gps_pictures import add_gps
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from support import fill_disk
from tiny_places import Pixels, place_words, ride, scene

from sextant.atomic_files import write_sealed_json
from sextant.chapters.places import describing, matching, written_matches
from sextant.chapters.places.data.tolerance import PlaceTolerance
from sextant.chapters.places.matching import match
from sextant.chapters.places.options import PlaceOptions, read_inputs
from sextant.chapters.places.place_map import PlaceMap
from sextant.chapters.places.predict import predict_places
from sextant.chapters.places.saved_map import TOLERANCES, Temperature
from sextant.cli import evaluate, predict
from sextant.composing.compose import compose, to_plain
from sextant.errors import UserError
from sextant.evaluation.positives import Positives
from sextant.kit import handler
from sextant.lifecycle.execute import execute
from sextant.retrieval import FlatIndex
from sextant.retrieval.without_mean import centred
from sextant.runs.checkpoint import KEY
from sextant.runs.directory import RunDirectory
from sextant.runs.resolve import FoundRun

PLACES = {"train": 32, "val": 16, "test": 20}


def look_up(reference, queries, output, network=None, temperature=0.1, tolerances=TOLERANCES, **given):
    """Match folders by pixels: the rows, and the content of matches.json."""
    arguments = {"map": str(reference), "queries": str(queries), "output": str(output)}
    inputs = read_inputs(arguments | {key: str(value) for key, value in given.items()})
    known = Temperature(temperature, "" if temperature else "none was fitted")
    places = PlaceMap(network or Pixels(), temperature=known, tolerances=tolerances)
    rows = predict_places(places, inputs, {"run": "x"})
    return rows, json.loads((output / "matches.json").read_text())


@pytest.fixture(autouse=True)
def small_gallery(monkeypatch):
    """Drawing takes longer than all the rest."""
    monkeypatch.setattr(written_matches, "QUERIES", 2)


@pytest.fixture
def rides(tmp_path):
    return ride(tmp_path / "day", range(6)), ride(tmp_path / "night", range(6), night=True)


# --- with a trained run ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    root = tmp_path_factory.mktemp("places")
    for number, (split, count) in enumerate(PLACES.items()):
        for light in ("day", "night"):
            ride(root / split / light, range(1000 * number, 1000 * number + count), light == "night")
    short = ("pooling.grid=null", "task.batch_places=8", "task.dimension=32", "task.baselines=false")
    chosen = place_words(root, root / "outputs", *short, "trainer.max_epochs=2")
    return root, RunDirectory(execute(to_plain(compose(chosen))).directory)


def test_it_says_what_the_test_of_the_run_says(trained, tmp_path, capsys):
    root, run = trained
    count, out = PLACES["test"], tmp_path / "out"
    predict.main(
        [f"run={run.path}", f"map={root}/test/day", f"queries={root}/test/night", f"output={out}", "places=order",
         f"matches={count}"]
    )  # fmt: skip
    told, metrics = json.loads((out / "matches.json").read_text()), run.results()["metrics"]
    assert told["counts"]["right"] / count == pytest.approx(metrics["test/recall_at_1"])
    assert told["temperature"] == metrics["test/place_temperature_pm0f_night_to_day"]
    assert told["run"]["data"] == run.state()["data"]
    likelihoods = [each["confidence"] for row in told["results"] for each in row["matches"] if each["right"]]
    assert len(likelihoods) == count
    assert -np.mean(np.log(likelihoods)) == pytest.approx(metrics["test/place_nll_pm0f_night_to_day"], rel=1e-3)
    for row in told["results"]:
        assert sum(each["confidence"] for each in row["matches"]) == pytest.approx(1, abs=1e-4)
    with (out / "matches.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [line["rank"] for line in lines] == [str(rank + 1) for rank in range(count)] * count
    assert [path.name for path in out.glob("*.png")] == ["matches_page1.png"]
    said = " ".join(capsys.readouterr().out.split())
    assert "assuming that this place is in the map" in said
    assert f"best match right: {told['counts']['right']} of the {count} queries" in said


def test_pairs_for_colmap_are_named_below_the_folder_around_both(rides, tmp_path, capsys):
    rows, _ = look_up(*rides, tmp_path / "out", colmap="true", matches=2)
    told = capsys.readouterr().out.replace("\n", "")
    assert str(tmp_path / "out" / "pairs.txt") in told
    lines = (tmp_path / "out" / "pairs.txt").read_text().splitlines()
    assert lines == [f"night/{row['query']} day/{found['match']}" for row in rows for found in row["matches"]]
    assert len(lines) == 12


@pytest.mark.parametrize("of", ["day", "night"])
def test_a_name_that_pairs_for_colmap_cannot_hold_is_told_before_the_work(rides, tmp_path, of):
    (tmp_path / of / "003.png").rename(tmp_path / of / "3 again.png")
    with pytest.raises(UserError, match=f"'{of}/3 again.png' has a space"):
        look_up(*rides, tmp_path / "out", colmap="true")
    assert not (tmp_path / "out").exists()
    assert look_up(*rides, tmp_path / "out")[0]


@pytest.mark.slow
@pytest.mark.parametrize("centring", ["running", "all"])
def test_the_mean_of_a_ride_is_taken_away(rides, tmp_path, centring):
    rows, told = look_up(*rides, tmp_path / "out", centring=centring)
    assert told["centring"] == centring
    assert any(f"fitted without centring={centring}" in remark for remark in told["remarks"])
    places, asked = PlaceMap(Pixels()), PlaceMap(Pixels())
    for one, ride_ in zip((places, asked), rides, strict=True):
        one.add(ride_)
    reference, queries = (one.described.index.references.rows for one in (places, asked))
    (less_reference, less_queries) = centred(reference, queries, centring)
    expected = less_queries @ less_reference.T
    for row, similarities in zip(rows, expected, strict=True):
        assert "confidence" not in row["matches"][0]
        assert row["matches"][0]["similarity"] == pytest.approx(similarities.max(), abs=1e-5)
    from_python = places.look_up_many(sorted(rides[1].iterdir()), centring=centring)
    assert [each.best.photo.name for each in from_python] == [row["matches"][0]["match"] for row in rows]


@pytest.mark.slow
def test_it_says_how_baselines_are_tested_on_the_same_folders(trained, tmp_path, capsys):
    root, run = trained
    rides = tmp_path / "two, rides"
    shutil.copytree(root / "test", rides)
    given = [f"map={rides}/day", f"queries={rides}/night", f"output={tmp_path / 'out'}", "places=order"]
    predict.main([f"run={run.path}", *given])
    said = capsys.readouterr().out.splitlines()
    told = json.loads((tmp_path / "out" / "matches.json").read_text())
    (remark,) = [remark for remark in told["remarks"] if remark.startswith("compare with training-free descriptors: ")]
    assert remark in said  # on one line, to be copied
    sextant, command, *words = shlex.split(remark.partition(": ")[2])
    assert (sextant, command) == ("sextant", "evaluate")
    evaluate.main([*words, "tracking=none", f"paths.outputs={root / 'outputs'}"])
    said = capsys.readouterr().out
    assert all(method in said for method in ("pixels", "patch-normalised", "whitened PCA"))
    (ours,) = [line for line in said.splitlines() if " network " in line and "untrained" not in line]
    assert f"{100 * told['counts']['right'] / PLACES['test']:.1f}" in ours


@pytest.mark.slow
def test_a_map_from_python_says_what_the_command_says(trained, tmp_path):
    root, run = trained
    out = tmp_path / "out"
    given = [f"map={root}/test/day", f"queries={root}/test/night", f"output={out}", "descriptors=true"]
    predict.main([f"run={run.path}", *given, "sequence=4"])
    rows = json.loads((out / "matches.json").read_text())["results"]
    new = PlaceMap.load(run.path)
    new.add(root / "test" / "day")
    photos = [root / "test" / "night" / row["query"] for row in rows]
    for places in (new, PlaceMap.open(out / "map", run=run.path)):
        for row, found in zip(rows, places.look_up_many(photos), strict=True):
            assert [(root / "test" / "day" / each["match"]) for each in row["matches"]] == [
                m.photo for m in found.matches
            ]
            for each, match_ in zip(row["matches"], found.matches, strict=True):
                assert each["similarity"] == pytest.approx(match_.similarity, abs=1e-5)
                assert each["confidence"] == pytest.approx(match_.confidence, abs=1e-5)
            assert row["margin"] == pytest.approx(found.margin, abs=1e-5)
        for row, found in zip(rows, places.look_up_sequence(photos, length=4), strict=True):
            assert row["sequence_matches"][0]["match"] == found.best.photo.name


def test_a_checkpoint_without_its_run_gives_similarities_only(trained, tmp_path, capsys):
    root, run = trained
    checkpoint = shutil.copy(run.last_checkpoint, tmp_path / "weights.ckpt")
    predict.main([f"run={checkpoint}", f"map={root}/test/day", f"queries={root}/test/night", f"output={tmp_path}/out"])
    told = json.loads((tmp_path / "out" / "matches.json").read_text())
    assert told["temperature"] is None
    assert all("confidence" not in each for row in told["results"] for each in row["matches"])
    assert "no confidence, similarities only: the checkpoint lies outside" in " ".join(capsys.readouterr().out.split())


def test_other_weights_of_the_run_do_not_take_its_temperature(trained, tmp_path):
    from sextant.chapters.places.saved_map import run_temperature

    _, run = trained
    assert run_temperature(FoundRun(run.last_checkpoint, run)).value is not None
    assert "not of best.ckpt" in run_temperature(FoundRun(run.best_checkpoint, run)).lacking
    begun = RunDirectory(tmp_path)
    begun.update_state({"digest": "x"})
    assert "not finished" in run_temperature(FoundRun(begun.last_checkpoint, begun)).lacking


def test_input_belongs_to_other_tasks(trained, tmp_path):
    root, run = trained
    with pytest.raises(UserError, match=r"does not take models of place_recognition.*\n.*map=<folder>"):
        predict.main([f"run={run.path}", f"input={root}/test/day", f"output={tmp_path}/out"])


# --- the mathematics -------------------------------------------------------------------------------------------------


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 9), st.integers(1, 5), st.floats(0.02, 2))
def test_confidence_and_margin_against_sums_written_out(seed, count, m, temperature):
    rng = np.random.default_rng(seed)
    reference, queries = (FlatIndex(rng.normal(size=(n, 4)).astype(np.float32)) for n in (count, m))
    labels = rng.integers(0, 3, count)
    same = Positives.from_mask((labels[:, None] == labels) & ~np.eye(count, dtype=bool))
    found = match(reference, queries, same, min(3, count), temperature=temperature)
    for i in range(m):
        s = [float(np.dot(q, r)) for q in queries.references.rows[i : i + 1] for r in reference.references.rows]
        total = sum(np.exp(value / temperature) for value in s)
        best = int(np.argmax(s))
        others = [s[j] for j in range(count) if labels[j] != labels[best]]
        assert found.neighbours.indices[i, 0] == best
        for rank, j in enumerate(found.neighbours.indices[i]):
            own = sum(np.exp(s[other] / temperature) for other in range(count) if labels[other] == labels[j])
            assert found.confidence[i, rank] == pytest.approx(own / total, abs=1e-5)
        if others:
            assert found.margin[i] == pytest.approx(s[best] - max(others), abs=1e-5)
        else:
            assert np.isnan(found.margin[i])


def test_neither_depends_on_the_block(monkeypatch):
    rng = np.random.default_rng(1)
    reference, queries = (FlatIndex(rng.normal(size=(n, 8)).astype(np.float32)) for n in (30, 11))
    same = Positives.within_frames(np.arange(30), np.arange(30), 2)
    first = match(reference, queries, same, 3, temperature=0.2)
    monkeypatch.setattr("sextant.chapters.places.matching.BLOCK", 61)
    second = match(reference, queries, same, 3, temperature=0.2)
    np.testing.assert_allclose(first.confidence, second.confidence, atol=1e-6)
    np.testing.assert_allclose(first.margin, second.margin, atol=1e-6)


# --- what is looked up, and how the truth is known -------------------------------------------------------------------


def test_rides_of_two_folders_are_not_neighbours(tmp_path):
    ride(tmp_path / "map" / "one", [0, 1])
    ride(tmp_path / "map" / "two", [2, 3])
    night = ride(tmp_path / "night", [1], True)
    rows, told = look_up(tmp_path / "map", night, tmp_path / "out", tolerance=1, matches=4)
    by_name = {each["match"]: each["confidence"] for each in rows[0]["matches"]}
    assert by_name["one/000.png"] == by_name["one/001.png"] > 0.5 > by_name["two/000.png"]
    assert told["tolerance"] == "pm1f"
    assert not any("a place of its own" in remark for remark in told["remarks"])


@pytest.mark.parametrize("known", ["csv", "csv around", "utm", "gps", "name", "order"])
def test_truth(tmp_path, known):
    name = "@{number}00@0@.png" if known == "utm" else "{k:03d}.png"
    day, night = ride(tmp_path / "day", range(4), name=name), ride(tmp_path / "night", [0, 1, 2, 9], True, name)
    if known == "csv around":
        rows = [f"day/{k:03d}.png,{100 * k},0" for k in range(4)]
        rows += [f"night/{k:03d}.png,{100 * n},0" for k, n in enumerate([0, 1, 2, 9])]
        (tmp_path / "poses.csv").write_text("\n".join(["file,x,y", *rows]))
    if known == "csv":
        for folder, places in ((day, range(4)), (night, [0, 1, 2, 9])):
            rows = [f"{k:03d}.png,{100 * n},0" for k, n in enumerate(places)]
            (folder / "poses.csv").write_text("\n".join(["file,x,y", *rows]))
    if known == "gps":
        for folder, places in ((day, range(4)), (night, [0, 1, 2, 9])):
            for k, n in enumerate(places):
                add_gps(folder / f"{k:03d}.png", 100 * n, 0)
    rows, told = look_up(day, night, tmp_path / "out", places=known.split()[0])
    frames = known in ("name", "order")  # there the last query is taken for the last map image
    assert [row["in_map"] for row in rows] == [True, True, True, frames]
    assert [row["matches"][0]["right"] for row in rows[:3]] == [True] * 3
    assert told["counts"]["in_map"] == 3 + frames
    assert told["counts"]["right"] >= 3
    table = list(csv.DictReader((tmp_path / "out" / "matches.csv").open()))
    assert table[0]["right"] == "true"


@pytest.mark.slow
def test_a_table_by_relative_paths_by_links_and_for_one_query(tmp_path, monkeypatch):
    """The folder may be named in any way, and rows of photos that are not asked for are no mistake."""
    for folder in (ride(tmp_path / "day", range(3)), ride(tmp_path / "night", range(3), True)):
        rows = [f"{k:03d}.png,{100 * k},0" for k in range(3)]
        (folder / "poses.csv").write_text("\n".join(["file,x,y", *rows]))
    (tmp_path / "link").symlink_to("day")
    monkeypatch.chdir(tmp_path)
    for reference, queries, count in (
        ("day", "night", 3),
        ("link", tmp_path / "night", 3),
        ("day", "night/001.png", 1),
    ):
        _, told = look_up(reference, queries, tmp_path / "out", places="csv")
        assert told["counts"]["right"] == told["counts"]["in_map"] == count


def test_what_is_wrong_with_all_photos_is_told_before_any_is_described(rides, tmp_path, monkeypatch):
    class Idle(Pixels):
        def describe(self, images):
            raise AssertionError

    with pytest.raises(UserError, match="has a table"):
        look_up(*rides, tmp_path / "out", Idle(), places="csv")
    monkeypatch.setattr(matching, "LARGEST_RIDES", 35)
    with pytest.raises(UserError, match="6 queries x 6 map images are more than 35"):
        look_up(*rides, tmp_path / "out", Idle(), sequence=2)


def test_any_tolerance_is_one(rides, tmp_path):
    _, told = look_up(*rides, tmp_path / "out", places="order", tolerance="2e9")
    assert told["counts"]["right"] == 6


def test_headings_that_are_not_known_are_not_compared_and_that_is_said(tmp_path):
    name = "@{number}00@0@.png"
    day, night = ride(tmp_path / "day", range(3), name=name), ride(tmp_path / "night", range(3), True, name)
    with_headings = TOLERANCES | {"m": PlaceTolerance("m", 5, 25, 30)}
    _, told = look_up(day, night, tmp_path / "o", places="utm", tolerances=with_headings)
    assert told["counts"]["in_map"] == 3
    assert any("headings are unknown" in remark for remark in told["remarks"])


def test_a_photo_is_turned_upright(tmp_path):
    day = ride(tmp_path / "day", range(4))
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by a quarter
    (tmp_path / "night").mkdir()
    scene(2).transpose(Image.Transpose.ROTATE_90).save(tmp_path / "night" / "q.jpg", exif=exif, quality=98)
    rows, told = look_up(day, tmp_path / "night", tmp_path / "out")
    assert rows[0]["matches"][0]["match"] == "002.png"
    assert rows[0]["matches"][0]["similarity"] > 0.98
    assert told["queries"]["stretched"] == []
    assert describing.upright_size(tmp_path / "night" / "q.jpg") == (48, 32)


@pytest.mark.parametrize("kind", ["jpg", "png", "bmp", "webp", "tif", "ppm"])
def test_formats(tmp_path, kind):
    day = ride(tmp_path / "day", range(4))
    name = f"[red]$q\\frac$ {'long ' * 9}.{kind}"  # neither markup nor mathematics
    scene(3).save(tmp_path / name)
    rows, _ = look_up(day, tmp_path / name, tmp_path / "out")
    assert [row["query"] for row in rows] == [name]
    assert rows[0]["matches"][0]["match"] == "003.png"


def test_sequences_find_what_single_photos_miss(tmp_path):
    day, night = ride(tmp_path / "day", range(12)), ride(tmp_path / "night", range(12), True)
    scene(3).save(night / "008.png")  # one photo that looks like another place
    rows, told = look_up(day, night, tmp_path / "out", sequence=5, places="order")
    row = rows[8]
    assert (row["matches"][0]["match"], row["sequence_matches"][0]["match"]) == ("003.png", "008.png")
    assert (row["matches"][0]["right"], row["sequence_matches"][0]["right"]) == (False, True)
    assert "confidence" not in row["sequence_matches"][0]
    assert (told["counts"]["right"], told["counts"]["right_by_sequence"]) == (11, 12)
    table = list(csv.DictReader((tmp_path / "out" / "matches.csv").open()))
    assert {line["sequence_right"] for line in table if line["rank"] == "1"} == {"true"}


def test_names_count_and_so_does_their_number(tmp_path):
    day = ride(tmp_path / "day", range(12), name="frame{k}.png")
    rows, told = look_up(day, ride(tmp_path / "n", range(2), True), tmp_path / "out", matches=50)
    assert [each["rank"] for each in rows[0]["matches"]] == list(range(1, 13))
    assert any("matches=50: the map has only 12 images" in remark for remark in told["remarks"])
    assert read_inputs({"map": str(day), "queries": str(tmp_path / "n")}).reference.names[1:3] == (
        "frame1.png", "frame2.png",
    )  # fmt: skip


def test_photos_of_another_shape_and_copies_are_told(rides, tmp_path):
    day, night = rides
    scene(1).resize((30, 90)).save(night / "tall.png")
    shutil.copy(day / "004.png", night / "copy.png")
    rows, told = look_up(day, night, tmp_path / "out")
    assert told["queries"]["stretched"] == ["tall.png"]
    assert any(remark.startswith("queries: 1 photo was stretched, such as tall.png, to") for remark in told["remarks"])
    assert [row["query"] for row in rows if row.get("same_file")] == ["copy.png"]
    assert any("1 query is a copy" in remark for remark in told["remarks"])


# --- what fails ------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_photo_that_fails_is_named_and_the_rest_go_on(rides, tmp_path, capsys):
    day, night = rides
    for folder in rides:
        (folder / "002.png").write_bytes(b"nothing")
    (night / "empty.jpg").touch()
    (night / "phone.heic").write_bytes(b"ftypheic")
    rows, told = look_up(day, night, tmp_path / "out", places="name")
    assert [row["query"] for row in rows if "error" in row] == ["002.png", "empty.jpg", "phone.heic"]
    assert told["map"]["failed"][0]["photo"] == "002.png"
    assert told["counts"] == {**told["counts"], "queries": 8, "failed": 3, "in_map": 5, "right": 5}
    table = list(csv.DictReader((tmp_path / "out" / "matches.csv").open()))
    errors = {line["query"]: line["error"] for line in table if line["error"]}
    assert list(errors) == ["002.png", "empty.jpg", "phone.heic"]
    assert "cannot be decoded" in errors["002.png"]
    assert "is empty" in errors["empty.jpg"]
    assert "is .heic, which is not decoded here" in errors["phone.heic"]
    said = capsys.readouterr().out
    assert "Skipped of map (1)" in said
    assert "Skipped of queries (3)" in said
    assert "phone.heic" in said
    assert "5 queries looked up among 5 map images, 3 failed" in said


@pytest.mark.parametrize(("batch", "number"), [(2, 6), (64, 6)])
def test_batches_of_which_none_can_be_read(rides, tmp_path, monkeypatch, batch, number):
    monkeypatch.setattr(describing, "BATCH", batch)
    day, night = rides
    for k in (2, 3):
        (night / f"{k:03d}.png").write_bytes(b"nothing")
    rows, _ = look_up(day, night, tmp_path / "out")
    assert [row.get("matches", [{"match": None}])[0]["match"] for row in rows] == [
        None if k in (2, 3) else f"{k:03d}.png" for k in range(number)
    ]


@pytest.mark.parametrize("key", ["map", "queries"])
def test_if_all_fail_the_command_fails(rides, tmp_path, key):
    for path in rides[key == "queries"].iterdir():
        path.write_bytes(b"nothing")
    with pytest.raises(UserError, match=f"{key}=.*none of 6 photos can be used") as raised:
        look_up(*rides, tmp_path / "out")
    for k in range(6):
        assert f"00{k}.png: cannot be decoded (7 bytes)" in raised.value.problem


def test_descriptors_that_are_not_finite_are_failures(rides, tmp_path):
    class Broken(Pixels):
        def describe(self, images):
            found = super().describe(images)
            found[0] = np.nan
            return found

    rows, told = look_up(*rides, tmp_path / "out", Broken())
    assert rows[0]["error"] == "the network's descriptor is not finite"
    assert told["counts"]["failed"] == len(told["map"]["failed"]) == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"map": "{tmp}/none"}, "map=.*does not exist"),
        ({"queries": "{tmp}/none"}, "queries=.*does not exist"),
        ({"map": "{tmp}/empty"}, "map=.*no photo there"),
        ({"map": "{tmp}/day/000.png"}, "is a file, not a folder"),
        ({"queries": "{tmp}/day"}, "are the same folder: 6 of 6 queries"),
        ({"queries": "{tmp}/day/000.png"}, "1 of 1 query is in the map as well"),
        ({"map": "{tmp}"}, "share files, because one lies in the other"),
        ({"queries": "{tmp}"}, "share files, because one lies in the other"),
        ({"matches": "0"}, "matches=0 must be a whole number from 1 up"),
        ({"sequence": "1"}, "sequence=1 must be a whole number from 2 up"),
        ({"sequence": "100"}, "sequence=100 is above the number of queries, 6"),
        ({"local": "trunk"}, "local=trunk is for rerank="),
        ({"places": "imu"}, "places=imu must be one of none, csv, utm, gps, name, order"),
        ({"tolerance": "-1"}, "tolerance=-1 must be a number from 0 up"),
        ({"tolerance": "nan"}, "tolerance=nan must be a number"),
        ({"descriptors": "yes"}, "descriptors=yes must be true, false or <map>"),
        ({"input": "x"}, "input= does not go with map="),
        ({"camera": "one"}, "camera= does not go with map="),
        ({"queries": None}, "queries= is missing"),
        ({"mapp": "x"}, r"Did you mean map=x\?"),
    ],
)
def test_mistakes_are_told_before_the_run_is_looked_for(rides, tmp_path, arguments, says):
    (tmp_path / "empty").mkdir()
    chosen = {"run": "x", "map": str(rides[0]), "queries": str(rides[1]), "output": str(tmp_path / "out")} | arguments
    with pytest.raises(UserError, match=says):
        predict.main([f"{k}={v.format(tmp=tmp_path)}" for k, v in chosen.items() if v is not None])


@pytest.mark.parametrize(
    ("places", "says"),
    [
        ("csv", "neither .*day nor its parent folder has a table poses.csv"),
        ("utm", "6 of 6 names contain no pose"),
        ("order", "pairs the i-th"),
    ],
)
def test_a_truth_that_is_not_there(rides, tmp_path, places, says):
    (rides[1] / "005.png").unlink()
    with pytest.raises(UserError, match=says):
        look_up(*rides, tmp_path / "out", places=places)


@pytest.mark.parametrize("key", ["matches", "map", "descriptors"])
def test_keys_of_places_are_refused_by_other_tasks(rides, tmp_path, monkeypatch, key):
    monkeypatch.setattr(handler, "resolve_run", lambda *_: FoundRun(tmp_path / "last.ckpt", None))
    monkeypatch.setattr("sextant.kit.trained.read_trained", lambda path: {KEY: {"task": "classification"}})
    given = [f"map={rides[0]}", f"queries={rides[1]}"] if key == "map" else [f"input={rides[0]}", f"{key}=3"]
    with pytest.raises(UserError, match=f"{key}= belongs to place_recognition; this is a model of classification"):
        predict.main(["run=x", f"output={tmp_path / 'out'}", *given])


# --- what is written -------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_map_is_described_once_and_used_again_without_its_photos(rides, tmp_path):
    day, night = rides
    (day / "bad.png").write_bytes(b"nothing")
    first, _ = look_up(day, night, tmp_path / "a", descriptors="true")
    assert {path.name for path in (tmp_path / "a" / "map").iterdir()} == {"map.json", "index.json", "descriptors.npy"}
    assert np.load(tmp_path / "a" / "queries" / "descriptors.npy", allow_pickle=False).dtype == np.float32
    shutil.rmtree(day)
    second, told = look_up(tmp_path / "a" / "map", night, tmp_path / "b")
    assert second == first
    assert told["map"]["failed"][0]["photo"] == "bad.png"
    with pytest.raises(UserError, match="are the same folder"):
        look_up(tmp_path / "a" / "queries", night, tmp_path / "c")


@pytest.mark.parametrize(
    ("harm", "says"),
    [
        ("model", "of another network"),
        ("decoder", "decodes photos differently"),
        ("version", "has version 99; this program reads version 1"),
        ("photos", "lacks keys"),
        ("other names", "is not the one that map.json was written for"),
        ("descriptors", "is damaged"),
        ("altered", "map.json was altered"),
    ],
)
def test_descriptors_that_cannot_be_used(rides, tmp_path, harm, says):
    look_up(*rides, tmp_path / "a", descriptors="true")
    folder = tmp_path / "a" / "map"
    header = json.loads((folder / "map.json").read_text())
    if harm == "descriptors":
        (folder / "descriptors.npy").write_bytes((folder / "descriptors.npy").read_bytes()[:-1])
    elif harm == "other names":
        write_sealed_json(folder / "map.json", header | {"photos": header["photos"][1:]})
    elif harm == "altered":
        (folder / "map.json").write_text(json.dumps(header | {"folder": "elsewhere"}))
    else:
        write_sealed_json(folder / "map.json", header | {harm: 99 if harm != "model" else "another"})
    with pytest.raises(UserError, match=says):
        look_up(folder, rides[1], tmp_path / "b")


def test_ctrl_c_keeps_the_map_and_leaves_nothing_half_written(rides, tmp_path):
    class Interrupted(Pixels):
        calls = 0

        def describe(self, images):
            self.calls += 1
            if self.calls == 2:
                raise KeyboardInterrupt
            return super().describe(images)

    with pytest.raises(KeyboardInterrupt):
        look_up(*rides, tmp_path / "out", Interrupted(), descriptors="true")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["map"]
    assert not list(tmp_path.rglob("*.tmp"))
    rows, _ = look_up(tmp_path / "out" / "map", rides[1], tmp_path / "out")
    assert len(rows) == 6


@pytest.mark.parametrize("name", ["matches.csv", "matches.json", "map.json", "descriptors.npy"])
def test_a_full_disk(rides, tmp_path, monkeypatch, name):
    fill_disk(monkeypatch, name)
    with pytest.raises(UserError, match="the disk is full"):
        look_up(*rides, tmp_path / "out", descriptors="true")


@pytest.mark.slow
def test_pages_of_the_gallery_are_no_photos_and_old_ones_go(rides, tmp_path, monkeypatch):
    day, night = rides
    monkeypatch.setattr(written_matches, "QUERIES", 5)
    monkeypatch.setattr(written_matches, "ON_A_PAGE", 2)
    out = tmp_path / "found"
    _, first = look_up(day, night, out)
    assert len(list(out.glob("matches_page*.png"))) == 3
    for k in (0, 1, 2, 3):
        (night / f"{k:03d}.png").unlink()
    (out / "matches_page_of_mine.svg.png").write_bytes(b"the user's")
    _, second = look_up(day, night, out)
    (out / "matches_page_of_mine.svg.png").unlink()  # not deleted by the command
    assert (first["queries"]["photos"], second["queries"]["photos"]) == (6, 2)
    assert [path.name for path in out.glob("matches_page*.png")] == ["matches_page1.png"]


def test_help_tells_of_every_key(capsys):
    with pytest.raises(SystemExit):
        predict.main(["--help"])
    said = capsys.readouterr().out
    assert all(f"\n  {key} " in said for key in ("map", "queries", *PlaceOptions.meanings()))
