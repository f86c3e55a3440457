"""Which store a name means."""

import re

import pytest

from sextant.data.rendered.verify import find_store, stores_in
from sextant.errors import UserError


@pytest.fixture
def cache(tmp_path):
    """Three stores, two of them of one dataset, and a folder that is none."""
    for name in ("town-1a", "town-2b", "office_walk-3c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "manifest.json").write_text("{}")
    (tmp_path / "photos-4d").mkdir()
    return tmp_path


def test_a_store_is_found_by_its_folder_its_name_and_its_dataset(cache):
    assert [path.name for path in stores_in(cache)] == ["office_walk-3c", "town-1a", "town-2b"]
    for name in (str(cache / "office_walk-3c"), "office_walk-3c", "office_walk"):
        assert find_store(name, cache) == cache / "office_walk-3c"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("town", "town: several stores of that name"),
        ("photos-4d", "photos-4d: no store of that name"),
        ("gone", "Stores there: office_walk-3c, town-1a, town-2b"),
    ],
)
def test_a_name_that_means_no_store_or_several_is_refused(cache, name, said):
    with pytest.raises(UserError, match=re.escape(said)):
        find_store(name, cache)
