import json

import pytest

from sextant.atomic_files import read_json, write_atomically, write_csv, write_json


def test_a_write_that_fails_leaves_the_previous_file_and_no_other(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"before")

    def half(file):
        file.write(b"aft")
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        write_atomically(path, half)
    assert path.read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_json_has_no_nan(tmp_path):
    path = tmp_path / "folder" / "x.json"
    write_json(path, {"a": float("nan"), "b": [float("inf"), 1.5]})
    assert json.loads(path.read_text()) == {"a": None, "b": [None, 1.5]}


def test_what_is_not_json_reads_as_none(tmp_path):
    (tmp_path / "x.json").write_text('{"a": 1')
    assert read_json(tmp_path / "x.json") is None
    assert read_json(tmp_path / "absent.json") is None


def test_a_table_has_its_columns_in_order_and_nothing_else(tmp_path):
    write_csv(tmp_path / "t.csv", ["b", "a"], [{"a": 1, "b": True, "c": 3}, {"a": "x, y"}])
    assert (tmp_path / "t.csv").read_bytes() == b'b,a\r\ntrue,1\r\n,"x, y"\r\n'
