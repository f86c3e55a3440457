r"""Names of images and rows: slashes, roots, suffixes, case, escapes, Unicode; exact before loose; doubt is refused."""

import pytest

from sextant.data.name_matching import match_names
from sextant.errors import UserError


@pytest.mark.parametrize(
    ("image", "row"),
    [
        ("a.jpg", "a.jpg"), ("a.jpg", "./a.jpg"), ("a.jpg", r".\a.jpg"), ("sub/a.jpg", r"sub\a.jpg"),
        ("sub/a.jpg", r"C:\data\sub\a.jpg"), ("sub/a.jpg", "/home/me/sub/a.jpg"), ("sub/a.jpg", "file:///sub/a.jpg"),
        ("sub/a.jpg", "a.jpg"), ("one/a.jpg", "two/a.jpg"), ("a.jpg", "sub//a.jpg"), ("a.jpg", "a"), ("a", "a.jpg"),
        ("a.JPG", "a.jpg"), ("A.jpg", "a.JPG"), ("A.JPG", "a"), ("sub/a", r"Sub\A.PNG"), ("a b.jpg", "a%20b.jpg"),
        ("gr\u00f6\u00dfe.jpg", "gro\u0308\u00dfe.jpg"), ("gro\u0308\u00dfe.jpg", "gr%C3%B6%C3%9Fe"),
        ("100%.jpg", "100%.jpg"), ("1305031102.175304.png", "1305031102.175304"), ("a.tiff", "./images/../a.tiff"),
        ("a.heic", "A"), (" a.jpg", "a.jpg"), ("train/r_0.png", "./train/r_0"),
    ],
)  # fmt: skip
def test_one_image_in_other_words(image, row):
    others = ["far/b.jpg", "c.png"]
    assert match_names(["b.jpg", image], [*others, row]).rows == [0, 2]


@pytest.mark.parametrize(
    ("image", "row"),
    [("a.jpg", "b.jpg"), ("a.jpg", "a.png"), ("a1.jpg", "a01.jpg"), ("ab.jpg", "b.jpg"), ("a.b.jpg", "a.jpg"),
     ("sub/a.jpg", "a/sub.jpg"), ("a.jpg", ""), ("1305031102.17.png", "1305031102.175304")],
)  # fmt: skip
def test_other_names_are_other_images(image, row):
    assert match_names([image], [row]).rows == [None]
    assert match_names([image], [row]).ambiguous == ()


@pytest.mark.parametrize(
    ("images", "rows", "expected"),
    [
        (["A.jpg", "a.jpg"], ["a.jpg", "A.jpg"], [1, 0]),
        (["a.jpg", "sub/a.jpg"], ["sub/a.jpg", "a.jpg"], [1, 0]),
        (["a.jpg", "sub/a.jpg"], ["a.jpg"], [0, None]),
        (["left/1.png", "right/1.png"], ["cam/right/1.png", "cam/left/1.png"], [1, 0]),
        (["1.jpg", "1.png"], ["1.png", "1"], [1, 0]),
        (["a%20b.jpg", "a b.jpg"], ["a b.jpg", "a%20b.jpg"], [1, 0]),
        ([], ["a"], []),
        (["a"], [], [None]),
    ],
)
def test_the_stricter_match_wins(images, rows, expected):
    assert match_names(images, rows).refuse_ambiguous("t").rows == expected


@pytest.mark.parametrize(
    ("images", "rows", "said"),
    [
        (["1.jpg"], ["left/1.jpg", "right/1.jpg"], "1.jpg may be left/1.jpg or right/1.jpg"),
        (["a/1.jpg", "b/1.jpg"], ["c/1.jpg"], "a/1.jpg and b/1.jpg may be c/1.jpg"),
        (["A.jpg"], ["a.jpg", "a.JPG"], "A.jpg may be a.jpg or a.JPG"),
        (["1.jpg", "1.png"], ["1"], "1.jpg and 1.png may be 1"),
        (["1"], ["1.jpg", "1.png"], "1 may be 1.jpg or 1.png"),
        (["1.jpg"], ["1.jpg", "1.jpg"], "1.jpg has 2 rows"),
    ],
)
def test_doubt_is_refused_with_both_sides(images, rows, said):
    found = match_names(images, rows)
    assert found.rows == [None] * len(images)
    with pytest.raises(UserError, match=r"t\.csv: 1 name is ambiguous: ") as told:
        found.refuse_ambiguous("t.csv")
    assert said in str(told.value)


def test_whole_paths_of_images_where_a_table_is_of_several_folders():
    assert match_names(["map/1.jpg"], ["1.jpg"], whole=True).rows == [None]
    assert match_names(["map/1.jpg"], [r"D:\x\map\1.JPG"], whole=True).rows == [0]
