"""A map described in parts is the map that one process describes."""

import pytest
from tiny_places import ride, scene, tiny_checkpoint

from sextant import PlaceMap, cli
from sextant.applications import FailedPhotosError
from sextant.chapters.places import describing, map_shards
from sextant.chapters.places.map_shards import describe_shard, merge_shards, photos_of, shard_folder
from sextant.chapters.places.photo_folder import photos_below
from sextant.errors import ArgumentError, UserError


@pytest.fixture
def photos(tmp_path, monkeypatch):
    """Eleven photos and one that is none, in batches of two."""
    monkeypatch.setattr(describing, "BATCH", 2)
    monkeypatch.setattr(map_shards, "BATCH", 2)
    folder = ride(tmp_path / "photos", range(11))
    (folder / "006b.png").write_bytes(b"no photo")
    return photos_below(folder)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return tiny_checkpoint(tmp_path_factory.mktemp("run") / "last.ckpt")


def files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.relative_to(folder).parts[0] != "shards"
    }


def test_three_parts_give_the_map_of_one_process_to_the_byte(photos, run, tmp_path):
    describe_shard(PlaceMap.load(run), photos, tmp_path / "whole", None, 1)
    for shard in (2, 0, 1):
        describe_shard(PlaceMap.load(run), photos, tmp_path / "parts", shard, 3)
    merged = PlaceMap.load(run)
    merge_shards(merged, photos, tmp_path / "parts", 3)
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    assert len(merged) == 11
    query = photos.paths[4]
    assert PlaceMap.open(tmp_path / "parts").look_up(query).best.photo == query


def test_every_photo_is_in_one_part(photos):
    for shards in range(1, 7):
        parts = [photos_of(photos, shard, shards).names for shard in range(shards)]
        assert tuple(name for part in parts for name in part) == photos.names
        assert all(parts)


def test_a_lost_damaged_or_foreign_part_is_named_and_is_all_that_is_made_again(photos, run, tmp_path):
    for shard in (0, 2):
        describe_shard(PlaceMap.load(run), photos, tmp_path / "map", shard, 3)
    with pytest.raises(UserError, match=r"not described yet: shard 1 of 3\n.*shards=3 shard=1"):
        merge_shards(PlaceMap.load(run), photos, tmp_path / "map", 3)
    describe_shard(PlaceMap.load(run), photos, tmp_path / "map", 1, 3)
    (rows,) = shard_folder(tmp_path / "map", 1, 3).glob("*.npy")
    content = bytearray(rows.read_bytes())
    content[-1] ^= 1
    rows.write_bytes(content)
    with pytest.raises(UserError, match="1_of_3"):
        merge_shards(PlaceMap.load(run), photos, tmp_path / "map", 3)
    describe_shard(PlaceMap("Hog"), photos, tmp_path / "map", 1, 3)
    with pytest.raises(UserError, match=r"shard 1 of 3 is of another network"):
        merge_shards(PlaceMap.load(run), photos, tmp_path / "map", 3)
    describe_shard(PlaceMap.load(run), photos, tmp_path / "map", 1, 3)
    fewer = type(photos)(photos.folder, photos.names[:-1])
    with pytest.raises(UserError, match=r"shard 2 of 3 is of other photos"):
        merge_shards(PlaceMap.load(run), fewer, tmp_path / "map", 3)
    assert not (tmp_path / "map" / "map.json").exists()
    merge_shards(PlaceMap.load(run), photos, tmp_path / "map", 3)


def test_a_part_without_usable_photos_is_merged_as_one_process_would_skip_it(photos, run, tmp_path):
    broken = [photos.folder / name for name in photos_of(photos, 1, 3).names]
    for path in broken:
        path.write_bytes(b"no photo")
    describe_shard(PlaceMap.load(run), photos, tmp_path / "whole", None, 1)
    for shard in range(3):
        failed = describe_shard(PlaceMap.load(run), photos, tmp_path / "parts", shard, 3)
        assert (len(failed) == len(broken)) == (shard == 1)
    other = (*photos.names[:4], "other.png", *photos.names[5:])
    with pytest.raises(UserError, match="shard 1 of 3 is of other photos"):
        merge_shards(PlaceMap.load(run), type(photos)(photos.folder, other), tmp_path / "parts", 3)
    assert merge_shards(PlaceMap.load(run), photos, tmp_path / "parts", 3).keys() == {path.name for path in broken}
    assert files(tmp_path / "parts") == files(tmp_path / "whole")
    scene(0).save(broken[0])
    assert len(describe_shard(PlaceMap.load(run), photos, tmp_path / "parts", 1, 3)) == len(broken) - 1
    merged = PlaceMap.load(run)
    merge_shards(merged, photos, tmp_path / "parts", 3)
    assert broken[0] in merged.described.paths


def test_parts_without_any_usable_photo_are_no_map(photos, run, tmp_path):
    for path in photos.paths:
        path.write_bytes(b"no photo")
    for shard in range(2):
        describe_shard(PlaceMap.load(run), photos, tmp_path / "map", shard, 2)
    with pytest.raises(FailedPhotosError, match="none of 12 photos could be described"):
        merge_shards(PlaceMap.load(run), photos, tmp_path / "map", 2)
    with pytest.raises(FailedPhotosError, match="none of 12 photos could be described"):
        describe_shard(PlaceMap.load(run), photos, tmp_path / "map", None, 1)


def test_wrong_numbers_are_refused(photos, run, tmp_path):
    for shard, shards, told in ((3, 3, "there are shards 0 to 2"), (0, 7, "12 photos in 6 batches of 2")):
        with pytest.raises(ArgumentError, match=told):
            describe_shard(PlaceMap.load(run), photos, tmp_path, shard, shards)


def test_the_command_describes_parts_and_puts_them_together(photos, run, tmp_path, capsys):
    words = ["describe", f"run={run}", f"map={photos.folder}", f"output={tmp_path / 'map'}"]
    for more in (["shards=2", "shard=1"], ["shards=2", "shard=0"], ["shards=2"]):
        cli.run("data", [*words, *more])
    said = capsys.readouterr().out
    assert "11 photos described" in said
    assert "006b.png" in said
    assert (tmp_path / "map" / "map.json").is_file()
    for wrong, told in ((["shard=1"], "shards= is missing"), (["shards=0"], "shards=0 must be")):
        with pytest.raises(SystemExit):
            cli.run("data", [*words, *wrong])
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("output=<photos>", "results would be mixed with it"),
        ("output=<photos>/map", "results would be read as part of it"),
        ("output=<photos>/000.png", "/000.png is not a folder that can be written to"),
        ("trust=maybe", "trust=maybe must be true or false"),
    ],
)
def test_a_wrong_output_is_refused_before_a_photo_is_described(wrong, said, photos, run, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(map_shards, "describe_shard", lambda *_: pytest.fail("it was described"))
    given = {"run": run, "map": photos.folder, "output": tmp_path / "map"}
    given |= [wrong.replace("<photos>", str(photos.folder)).split("=")]
    with pytest.raises(SystemExit):
        cli.run("data", ["describe", *(f"{key}={value}" for key, value in given.items())])
    told = capsys.readouterr().err
    assert wrong.split("/")[0].split("<")[0] in told
    assert said in told


def test_a_map_that_cannot_be_written_is_one_message(photos, run, tmp_path, capsys):
    (tmp_path / "map" / "map.json").mkdir(parents=True)
    with pytest.raises(SystemExit) as ended:
        cli.run("data", ["describe", f"run={run}", f"map={photos.folder}", f"output={tmp_path / 'map'}"])
    assert ended.value.code == 2
    assert f"output={tmp_path / 'map'} cannot be written to" in capsys.readouterr().err
