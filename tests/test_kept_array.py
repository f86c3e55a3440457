"""Arrays in the cache: opened as they were written, else not at all."""

from functools import partial

import numpy as np
import pytest

from sextant.kept_array import keep_array, open_kept

ROWS = np.arange(24, dtype=np.float32).reshape(6, 4)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "cache" / "rows.npy"
    keep_array(path, partial(np.lib.format.write_array, array=ROWS))
    return path


def test_an_array_is_mapped_as_it_was_kept(path):
    found = open_kept(path, (6, None), np.float32)
    assert isinstance(found, np.memmap)
    np.testing.assert_array_equal(found, ROWS)


def test_a_flipped_byte_is_noticed(path):
    content = bytearray(path.read_bytes())
    content[-7] ^= 1
    path.write_bytes(content)
    assert open_kept(path, (6, None), np.float32) is None


def test_a_file_cut_short_is_noticed(path):
    path.write_bytes(path.read_bytes()[:-8])
    assert open_kept(path, (6, None), np.float32) is None


@pytest.mark.parametrize(("shape", "dtype"), [((5, None), np.float32), ((6,), np.float32), ((6, 4), np.uint8)])
def test_another_array_is_not_taken(path, shape, dtype):
    assert open_kept(path, shape, dtype) is None


def test_there_is_none(tmp_path):
    assert open_kept(tmp_path / "rows.npy", (6, None), np.float32) is None


def test_a_whole_file_from_before_there_were_hashes_is_believed(path):
    path.with_name("rows.npy.sha256").unlink()
    assert open_kept(path, (6, 4), np.float32) is not None


def test_writing_that_fails_leaves_nothing(tmp_path):
    def write(file):
        file.write(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        keep_array(tmp_path / "rows.npy", write)
    assert not list(tmp_path.iterdir())
