import hashlib
import os
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.atomic_files import file_sha256
from sextant.data.source import ImageSource, MissingDataError, channels_first, check_file, find_folder
from sextant.errors import UserError


class Files(ImageSource):
    """A source of the files it is given."""

    name = "files"

    def __init__(self, **splits):
        self.splits = splits

    def files(self, split):
        if split not in self.splits:
            raise MissingDataError(f"no {split}")
        return self.splits[split]

    def spec(self):
        raise NotImplementedError

    def read(self, split):
        raise NotImplementedError


@pytest.fixture
def files(tmp_path):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path in paths:
        path.write_text(f"content of {path.name}")
    return paths


def test_the_fingerprint_does_not_depend_on_times(files):
    source = Files(train=files[:2], test=files[2:])
    before = source.fingerprint()
    for path in files:
        os.utime(path, (1, 1))
    assert source.fingerprint() == before


@pytest.mark.parametrize("changed", [0, 1, 2])
def test_the_fingerprint_changes_with_the_content_of_any_file(files, changed):
    source = Files(train=files[:2], test=files[2:])
    before = source.fingerprint()
    files[changed].write_text("something else")
    assert source.fingerprint() != before


def test_the_fingerprint_changes_with_the_name_of_a_file(files):
    a, b, c = files
    before = Files(train=[a, b], test=[c]).fingerprint()
    assert Files(train=[a, b], test=[c.rename(c.with_name("d"))]).fingerprint() != before


def test_the_fingerprint_tells_order_splits_and_missing_splits_apart(files):
    a, b, c = files
    splits = [{"train": [a, b], "test": [c]}, {"train": [b, a], "test": [c]}, {"train": [a], "test": [b, c]}]
    splits += [{"train": [a, b]}, {"test": [c]}, {}]
    assert len({Files(**split).fingerprint() for split in splits}) == len(splits)


def test_a_remembered_hash_is_forgotten_when_the_file_changes(files):
    path = files[0]
    assert file_sha256(path) == hashlib.sha256(b"content of a").hexdigest()
    path.write_text("CONTENT OF A")
    os.utime(path, ns=(0, path.stat().st_mtime_ns + 1))
    assert file_sha256(path) == hashlib.sha256(b"CONTENT OF A").hexdigest()


@pytest.mark.parametrize("algorithm", ["md5", "sha256"])
def test_a_file_is_checked_against_its_published_hash(files, algorithm):
    published = hashlib.new(algorithm, b"content of a").hexdigest()
    check_file(files[0], published, algorithm)
    found = hashlib.new(algorithm, b"content of b").hexdigest()
    with pytest.raises(
        UserError, match=f"{files[1]} is damaged.*: 12 bytes, {algorithm} {found}, expected {published}"
    ):
        check_file(files[1], published, algorithm)


def test_the_first_folder_that_holds_all_files_is_taken(tmp_path):
    for root, names in (("first", "a"), ("second", "ab"), ("third", "ab")):
        (tmp_path / root / "set").mkdir(parents=True)
        for name in names:
            (tmp_path / root / "set" / name).touch()
    roots = [tmp_path / root for root in ("first", "second", "third")]
    assert find_folder(roots, "set", ["a", "b"], dataset="d", source="s") == tmp_path / "second" / "set"


def test_files_that_lie_nowhere_together_are_named_with_every_folder_looked_in(tmp_path):
    (tmp_path / "first" / "set").mkdir(parents=True)
    (tmp_path / "first" / "set" / "a").touch()
    roots = [tmp_path / "first", tmp_path / "second"]
    places = "\n".join(f"  {root / 'set'}" for root in roots)
    with pytest.raises(MissingDataError, match=re.escape(f"dataset=d: b not found. Looked in\n{places}")) as caught:
        find_folder(roots, "set", ["a", "b"], dataset="d", source="the publisher's layout")
    assert "the publisher's layout" in caught.value.fix
    assert "dataset=digits" in caught.value.fix


@given(st.integers(1, 3), st.integers(1, 4), st.integers(1, 4))
def test_channels_come_before_rows_and_columns(count, height, width):
    colour = np.random.default_rng(0).integers(256, size=(count, height, width, 3)).astype(np.uint8)
    first = channels_first(colour)
    assert first.flags.c_contiguous
    assert all(np.array_equal(first[:, c], colour[..., c]) for c in range(3))
    assert np.array_equal(channels_first(colour[..., 0]), colour[:, None, :, :, 0])
