"""The user's folders: every way to know places, and every way to get them wrong."""

import os

import numpy as np
import pytest
from data.places.gps_pictures import add_gps
from data.places.place_pictures import picture, write_pictures
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sextant.chapters.places.data import PlaceFolders, PlaceTolerance, as_place_source
from sextant.chapters.places.data.pose_files import Pose, parse_utm_name, read_pose_table
from sextant.data.image_files import decode_image, natural_key
from sextant.data.picture_files import UnreadableImageError
from sextant.data.source import MissingDataError
from sextant.errors import UserError

TEST = {"reference": "reference", "query": "query"}
SMALL = {"height": 16, "width": 24}


@pytest.fixture
def folder(tmp_path):
    """Three places, seen twice under other names."""
    root = tmp_path / "mine"
    write_pictures(root / "reference", ["a2.png", "a10.png", "a1.png"])
    write_pictures(root / "query", ["b1.png", "b2.png", "b3.png"], first=10)
    return root


def folders(folder, **changes):
    return PlaceFolders(**({"folder": str(folder), "test": TEST, **SMALL} | changes))


def table(folder, traverse, rows, header="file,x,y,heading"):
    (folder / traverse / "poses.csv").write_text("\n".join([header, *rows]))


# -- by order and by name ----------------------------------------------------------------------------------------------


def test_by_order_numbers_count_as_numbers(folder):
    images = folders(folder, places="order").read("test")
    assert [name.split("/")[1] for name in images.names] == [
        "a1.png",
        "a2.png",
        "a10.png",
        "b1.png",
        "b2.png",
        "b3.png",
    ]
    assert images.frame.tolist() == [0, 1, 2, 0, 1, 2]
    assert images.traverse.tolist() == [0, 0, 0, 1, 1, 1]
    assert images.conditions == ("reference", "query")
    assert np.array_equal(images.images[0], picture(2))
    assert images.position_m is None
    matrix = images.positives(images.rows_of("query"), images.rows_of("reference"), PlaceTolerance("frames", 0, 1))
    assert np.array_equal(matrix.toarray(), np.eye(3, dtype=bool))


def test_by_order_other_lengths_are_refused(folder):
    (folder / "query" / "b2.png").unlink()
    with pytest.raises(
        UserError, match=r"differ in length\n  reference: 3 images, a1.png to a10.png\n  query: 2 images"
    ):
        folders(folder, places="order").files("test")


def test_by_name_frames_without_a_partner_are_named(tmp_path):
    write_pictures(tmp_path / "reference", ["1.png", "2.png", "3.png"])
    write_pictures(tmp_path / "query", ["1.jpg", "3.png", "4.png"], first=10)
    with pytest.raises(UserError, match=r"3 frames|2 frames lack a partner") as told:
        folders(tmp_path, places="name").files("test")
    assert "reference/4" in str(told.value)
    assert "query/2" in str(told.value)
    images = folders(tmp_path, places="name", skip_bad=True).read("test")
    assert images.frame.tolist() == [0, 1, 2, 0, 2, 3]
    assert images.skipped == ("reference/4 is missing", "query/2 is missing")
    matrix = images.positives(images.rows_of("query"), images.rows_of("reference"), PlaceTolerance("frames", 0, 1))
    assert matrix.toarray().sum(1).tolist() == [1, 1, 0]


def test_one_frame_of_two_suffixes_is_refused(tmp_path):
    write_pictures(tmp_path / "reference", ["1.png", "1.jpg"])
    write_pictures(tmp_path / "query", ["1.png"], first=10)
    with pytest.raises(UserError, match="two frames of the same name"):
        folders(tmp_path, places="name").files("test")


@given(st.lists(st.text("ab0129.", min_size=1, max_size=6), unique=True))
def test_natural_order_is_one_order(names):
    keys = sorted(map(natural_key, names))
    assert len(set(map(str, keys))) == len(names)
    assert natural_key("image2") < natural_key("image10") < natural_key("image010a")


# -- by a table --------------------------------------------------------------------------------------------------------


def test_a_table_in_each_folder_places_its_images(folder):
    table(folder, "reference", ["a1.png,0,0,350", "a2.png, 10, 0, 0", "a10.png,20,0,0"], "file, X ,y,heading")
    table(folder, "query", ["b3.png,19,1,0", "b1.png,0.5,0,10", "b2.png,11,0,180", ""])
    images = folders(folder, places="csv").read("test")
    assert images.position_m.tolist() == [[0, 0], [10, 0], [20, 0], [0.5, 0], [11, 0], [19, 1]]
    assert images.heading_deg.tolist() == [350, 0, 0, 10, 180, 0]
    assert not images.aligned
    query, reference = images.rows_of("query"), images.rows_of("reference")
    assert np.array_equal(
        images.positives(query, reference, PlaceTolerance("m", 2, 5, 30)).toarray(), np.diag([True, False, True])
    )
    assert np.array_equal(
        images.positives(query, reference, PlaceTolerance("m", 2, 5)).toarray(), np.eye(3, dtype=bool)
    )


def circle(unit):
    angles = np.linspace(0, 2 * np.pi, 40)
    return [f"{k}.png,{10 * np.sin(a)},{-10 * np.cos(a)},{a * unit}" for k, a in enumerate(angles)]


@pytest.mark.parametrize(
    ("rows", "header", "told"),
    [
        (circle(1.0), "file,x,y,heading", "headings of at most 6.28 follow the way as radians, not as degrees"),
        (circle(180 / np.pi), "file,x,y,heading", ""),
        ([f"{k}.png,{k},0,{0.01 * k}" for k in range(9)], "file,x,y,heading", ""),
        (["a.png,0,0,1", "b.png,1,0,1"], "file,x,y,theta", "the column theta is not read; headings are degrees"),
    ],
    ids=["radians", "degrees", "straight", "theta"],
)
def test_headings_in_another_unit_or_column_are_warned_of(tmp_path, caplog, rows, header, told):
    (tmp_path / "poses.csv").write_text("\n".join([header, *rows]))
    read_pose_table(tmp_path / "poses.csv")
    assert told in caplog.text if told else not caplog.text


def test_one_table_around_all_folders(folder):
    names = [f"reference/a{k}.png" for k in (1, 2, 10)] + [f"query/b{k}.png" for k in (1, 2, 3)]
    (folder / "all.csv").write_text(
        "\ufefffile,y,note,x\n" + "\n".join(f"{name},{k},-,7" for k, name in enumerate(names))
    )
    images = folders(folder, places="csv", csv="all.csv").read("test")
    assert images.position_m.tolist() == [[7, k] for k in range(6)]
    assert images.heading_deg is None


@pytest.mark.parametrize(
    ("rows", "header", "told"),
    [
        (["a1.png,0,0,0", "a2.png,0,nan,0", "a10.png,0,0,0"], None, "line 3: y='nan' of a2.png must be a finite"),
        (["a1.png,0,0,0", "a2.png,0,,0", "a10.png,0,0,0"], None, "y='' of a2.png"),
        (["a1.png,0,0,0", "a2.png,0,0,", "a10.png,0,0,0"], None, "heading='' of a2.png"),
        (["a1.png,east,0,0", "a2.png,0,0,0", "a10.png,0,0,0"], None, "line 2: x='east'"),
        (["a1.png,0,0,0", "a1.png,0,0,0", "a2.png,0,0,0", "a10.png,0,0,0"], None, "line 3: a1.png has a row already"),
        (["a1.png,0,0,0", "a2.png,0", "a10.png,0,0,0"], None, "line 3: 2 values for 4 columns"),
        (["a1.png,0,0,0", "a10.png,0,0,0"], None, "1 of 3 images has no row"),
        (
            ["a1.png,0,0,0", "a2.png,0,0,0", "a10.png,0,0,0", "a3.png,0,0,0"],
            None,
            "1 row of .* has no image\n  a3.png",
        ),
        (["a1.png,0,0"], "file,lat,lon", r"columns file, lat, lon; the first line must name file, x and y"),
        ([], "", r"columns \(none\)"),
    ],
)
def test_tables_with_mistakes_are_refused(folder, rows, header, told):
    table(folder, "query", ["b1.png,0,0,0", "b2.png,0,0,0", "b3.png,0,0,0"])
    table(folder, "reference", rows, "file,x,y,heading" if header is None else header)
    with pytest.raises(UserError, match=told):
        folders(folder, places="csv").read("test")


def test_a_missing_table_is_told(folder):
    with pytest.raises(MissingDataError, match=r"has a table poses.csv"):
        folders(folder, places="csv").read("test")


@pytest.mark.parametrize("csv", ["poses.csv", "all.csv"])
def test_folders_and_files_may_be_links(folder, tmp_path, csv):
    elsewhere = (folder / "query").rename(tmp_path / "elsewhere")
    (folder / "query").symlink_to(elsewhere)
    target = (elsewhere / "b1.png").rename(tmp_path / "far.png")
    (elsewhere / "b1.png").symlink_to(target)
    rows = {name: [f"{p.name},{k},0,0" for k, p in enumerate((folder / name).iterdir())] for name in TEST}
    if csv == "all.csv":
        around = [f"{name}/{row}" for name, own in rows.items() for row in own]
        (folder / csv).write_text("\n".join(["file,x,y,heading", *around]))
    else:
        for name, own in rows.items():
            table(folder, name, own)
    images = folders(folder, places="csv", csv=csv).read("test")
    expected = {row.split(",")[0]: float(row.split(",")[1]) for own in rows.values() for row in own}
    assert {name.split("/")[1]: x for name, x in zip(images.names, images.position_m[:, 0], strict=True)} == expected


def test_an_open_quotation_mark_is_told(tmp_path):
    (tmp_path / "poses.csv").write_text('file,x,y\n"a.png,0,0\n' + 20_000 * "b.png,0,0\n")
    with pytest.raises(UserError, match=r"poses.csv: line \d+ cannot be read: .*\nIs a quotation mark open above"):
        read_pose_table(tmp_path / "poses.csv")


def test_a_table_that_is_no_text_is_told(tmp_path):
    (tmp_path / "poses.csv").write_bytes(b"\xff\xfe\x00file")
    with pytest.raises(UserError, match="is not text in UTF-8"):
        read_pose_table(tmp_path / "poses.csv")


# -- by UTM names ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "pose"),
    [
        ("@0584000.25@4476000.50@17@T@40.4@-80.0@pano@02@275@010@@@2013@note@.jpg", Pose(17584000.25, 4476000.5, 275)),
        ("@0@00002.4@@@@@1@@@@@@@@.jpg", Pose(0, 2.4, None)),
        ("@12.5@-3@.png", Pose(12.5, -3, None)),
        ("@12.5@3.png", Pose(12.5, 3, None)),
        ("@334000.00@9999990.00@32@M@@@@@@.jpg", Pose(32334000, -10, None)),
        ("@334000.00@10.00@32@N@@@@@@.jpg", Pose(32334000, 10, None)),
        ("image.jpg", None), ("@.jpg", None), ("@1@.jpg", None), ("@a@2@.jpg", None), ("@nan@2@.jpg", None),
        ("@1@2@32@south@@@@@@.jpg", None),
        ("x@1@2@.jpg", None), ("@1@2@x@@@@@@@.jpg", None), ("@1@2@@@@@@@north@.jpg", None),
    ],
)  # fmt: skip
def test_names_tell_poses(name, pose):
    assert parse_utm_name(name) == pose


def test_neighbours_across_the_equator_are_near():
    north, south = (parse_utm_name(f"@334000@{y}@32@{letter}@.jpg") for y, letter in (("3", "N"), ("9999998", "M")))
    assert north.y - south.y == 5


def test_gps_folders(folder):
    for k, file in enumerate(("reference/a1.png", "reference/a2.png", "query/b1.png", "query/b2.png", "query/b3.png")):
        add_gps(folder / file, 10 * k, -5 * k)
    with pytest.raises(UserError, match=r"test: 1 of 6 images has no GPS position in EXIF\n.*a10.png"):
        folders(folder, places="gps").read("test")
    (folder / "reference" / "a10.png").unlink()
    source = folders(folder, places="gps")
    images = source.read("test")
    np.testing.assert_allclose(images.position_m, [(10 * k, -5 * k) for k in range(5)], rtol=0, atol=1e-4)
    assert source.place_unit == "m"
    assert images.heading_deg is None


def test_utm_folders(tmp_path):
    write_pictures(tmp_path / "reference", [f"@{x}@100@10@S@@@@@{h}@@@@@@.png" for x, h in ((0, 0), (30, 90))])
    write_pictures(tmp_path / "query", ["@4@103@10@S@@@@@@@@@@@.png"], first=5)
    images = folders(tmp_path, places="utm").read("test")
    assert np.array_equal(images.heading_deg, [0, 90, np.nan], equal_nan=True)  # the query has none
    with pytest.raises(UserError, match="headings of these images are not known"):
        images.positives(np.array([2]), np.array([0, 1]), PlaceTolerance("m", 5, 25, 30))
    found = images.positives(np.array([2]), np.array([0, 1]), PlaceTolerance("m", 5, 25))
    assert found.toarray().tolist() == [[True, False]]
    write_pictures(tmp_path / "query", ["late.png"], first=6)
    with pytest.raises(UserError, match=r"1 of 2 names contains no pose\n  late.png"):
        folders(tmp_path, places="utm").read("test")


# -- files -------------------------------------------------------------------------------------------------------------


def test_a_corrupt_frame_is_named_or_counted(folder, tmp_path):
    (folder / "query" / "b2.png").write_bytes(b"no image")
    for roots in ((), (tmp_path / "cache",), (tmp_path / "cache",)):
        with pytest.raises(UserError, match=r"1 of 6 cannot be read\n  query/b2.png cannot be decoded \(8 bytes\)"):
            folders(folder, places="order", roots=roots).read("test")
        images = folders(folder, places="order", roots=roots, skip_bad=True).read("test")
        assert len(images) == 5
        assert images.frame.tolist() == [0, 1, 2, 0, 2]  # partners stay partners
        assert np.array_equal(images.images[4], picture(12))
        assert len(images.skipped) == 1
        assert "b2.png" in images.skipped[0]


def test_a_condition_without_a_readable_image_is_refused(folder):
    for path in (folder / "query").iterdir():
        path.write_text(f"no image, {path.name}")
    with pytest.raises(UserError, match=r"test.query: none of its images can be read"):
        folders(folder, places="order", skip_bad=True).read("test")


def test_an_empty_or_missing_folder_is_named(folder, tmp_path):
    (folder / "night").mkdir()
    with pytest.raises(MissingDataError, match=r"test.night=.*holds no images"):
        folders(folder, places="order", test={"reference": "reference", "night": "night"}).files("test")
    with pytest.raises(MissingDataError, match=r"test.fog=.*fog does not exist"):
        folders(folder, places="order", test={"reference": "reference", "fog": "fog"}).files("test")
    with pytest.raises(MissingDataError, match=r"no such folder\. Looked for"):
        folders(tmp_path / "nowhere", roots=[tmp_path]).files("test")
    with pytest.raises(MissingDataError, match=r"train is null"):
        folders(folder).files("train")


def test_one_folder_cannot_be_two(folder):
    with pytest.raises(UserError, match="have the same files"):
        folders(folder, places="order", test={"a": "query", "b": "./query"}).files("test")
    with pytest.raises(UserError, match="have the same files"):
        folders(folder, places="order", test={"a": "query", "b": "."}).files("test")
    with pytest.raises(UserError, match=r"test.query=query and train.x=query have files in common"):
        folders(folder, places="order", train={"x": "query"}).files("test")
    with pytest.raises(UserError, match=r"train.x=. have files in common"):
        folders(folder, places="order", train={"x": "."}).files("test")


def test_duplicate_files_are_named_or_allowed(folder):
    (folder / "query" / "b3.png").write_bytes((folder / "reference" / "a2.png").read_bytes())
    with pytest.raises(UserError, match=r"1 file is a duplicate of another\n  reference/a2.png = query/b3.png"):
        folders(folder, places="order").read("test")
    assert len(folders(folder, places="order", allow_duplicates=True).read("test")) == 6


def test_what_is_decoded_is_kept_and_read_from_the_map(folder, tmp_path, monkeypatch):
    source = folders(folder, places="order", roots=[tmp_path / "cache"])
    first = source.read("test").images[:]
    monkeypatch.setattr("sextant.chapters.places.data.decoded_images.decode_image", None)
    assert np.array_equal(folders(folder, places="order", roots=[tmp_path / "cache"]).read("test").images[:], first)
    kept = next((tmp_path / "cache").rglob("images.npy"))
    kept.write_bytes(kept.read_bytes()[:-1])
    with pytest.raises(TypeError):  # a damaged file is decoded again
        source.read("test")


def test_splits_of_deeper_images_have_one_white_level_also_in_the_cache(tmp_path):
    def write(traverse, top):
        (tmp_path / traverse).mkdir(exist_ok=True)
        Image.fromarray(np.full((16, 24), top, np.uint16)).save(tmp_path / traverse / "a.png")

    def brightest(roots):
        source = folders(tmp_path, places="order", channels=1, train={"x": "day"}, allow_duplicates=True, roots=roots)
        return [source.read(split).images[0].max() for split in ("train", "test")]

    for traverse, top in (("day", 4000), ("reference", 900), ("query", 900)):
        write(traverse, top)
    for roots in ([], [tmp_path / "cache"], [tmp_path / "cache"]):
        assert brightest(roots) == [4000 >> 4, 900 >> 4]
    write("day", 60000)
    assert brightest([tmp_path / "cache"]) == [60000 >> 8, 900 >> 8]


def test_the_fingerprint_follows_files_places_and_splits(folder):
    source = folders(folder, places="order")
    before = source.fingerprint()
    assert folders(folder, places="order").fingerprint() == before
    assert folders(folder, places="order", test={"query": "query", "reference": "reference"}).fingerprint() != before
    assert folders(folder, places="order", width=32).fingerprint() != before
    path = folder / "query" / "b1.png"
    Image.fromarray(picture(99)).save(path)
    os.utime(path, ns=(1, 1))
    changed = source.fingerprint()
    assert changed != before
    table(folder, "reference", [f"a{k}.png,0,{k},0" for k in (1, 2, 10)])
    table(folder, "query", [f"b{k}.png,0,{k},0" for k in (1, 2, 3)])
    placed = folders(folder, places="csv").fingerprint()
    table(folder, "query", [f"b{k}.png,1,{k},0" for k in (1, 2, 3)])
    assert folders(folder, places="csv").fingerprint() != placed


def test_a_way_to_know_places_must_exist(folder):
    with pytest.raises(UserError, match=r"places='imu' must be one of csv, utm, gps, order, name"):
        folders(folder, places="imu")
    assert as_place_source(folders(folder)).place_unit == "m"


def test_bad_files_say_what_is_wrong(tmp_path):
    Image.fromarray(picture(0)).save(tmp_path / "good.jpg")
    whole = (tmp_path / "good.jpg").read_bytes()
    for name, content, told in (
        ("cut.jpg", whole[: len(whole) // 2], "cannot be decoded"),
        ("none.jpg", b"", "is empty"),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(UnreadableImageError, match=told):
            decode_image(tmp_path / name, 24, 48, 3)
