import numpy as np
import pytest
from cli.cosfire_detection.drawn import drawn

from sextant.errors import UserError
from sextant.tools.demonstration.where_else import glow, where_else_answer

SIZE, THERE = (440, 330), ((110, 110), (310, 190))


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    drawn(folder / "two.png", SIZE, glyphs=THERE)
    drawn(folder / "one.png", SIZE, glyphs=((200, 150),))
    return [folder / "two.png", folder / "one.png"]


def share(point):
    return (point[0] + 0.5) / SIZE[0], (point[1] + 0.5) / SIZE[1]


def strong(photo):
    return sorted((each["x"], each["y"]) for each in photo["found"] if each["score"] > 0.7)


@pytest.mark.slow
def test_similar_spots_are_found_in_both_photos(photos):
    found = where_else_answer(photos, [(0, *share(THERE[0]))])
    here, there = found["photos"]
    np.testing.assert_allclose(strong(here), [share(point) for point in THERE], atol=0.02)
    np.testing.assert_allclose(strong(there), [share((200, 150))], atol=0.02)
    (example,) = found["examples"]
    assert example["photo"] == 0
    assert len(example["parts"]) > 3
    assert all(np.hypot(part["x"] - example["x"], part["y"] - example["y"]) < 0.2 for part in example["parts"])
    assert here["response"].startswith("data:image/webp;base64,")


@pytest.mark.slow
@pytest.mark.parametrize("points", [[THERE[0]], [THERE[0], (114, 110)]])
def test_what_was_pointed_at_is_no_match_of_its_own(photos, points):
    found = where_else_answer(photos, [(0, *share(point)) for point in points])
    own = [[each["own"] for each in photo["found"] if each["score"] > 0.7] for photo in found["photos"]]
    assert [sorted(each) for each in own] == [[False, True], [False]]


@pytest.mark.slow
def test_an_example_may_be_of_the_second_photo(photos):
    found = where_else_answer(photos, [(1, *share((200, 150)))])
    assert len(strong(found["photos"][0])) == 2


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([], "0 given"),
        ([(0, 0.5, 0.5)] * 4, "4 given"),
        ([(2, 0.5, 0.5)], "lies outside the photos"),
        ([(0, 1.5, 0.5)], "lies outside the photos"),
    ],
)
def test_a_wrong_point_is_named(photos, points, said):
    with pytest.raises(UserError, match=said):
        where_else_answer(photos, points)


def test_where_nothing_is_no_filter_can_be_made(tmp_path, photos):
    drawn(tmp_path / "empty.png", SIZE, glyphs=())
    with pytest.raises(UserError, match=r"empty\.png"):
        where_else_answer([tmp_path / "empty.png"], [(0, 0.5, 0.5)])


def test_a_glow_is_the_stronger_the_brighter_and_nothing_where_nothing_answers():
    colours = glow(np.array([[-0.2, 0.0, 0.3, 0.8, 1.0, 1.4]]))
    assert colours.shape == (1, 6, 4)
    assert list(colours[0, :2, 3]) == [0, 0]
    assert (np.diff(colours[0, 1:5, 3].astype(int)) > 0).all()
    np.testing.assert_array_equal(colours[0, 4], colours[0, 5])
