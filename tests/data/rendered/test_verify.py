"""Every damaged byte is found, and only what it damages is rendered again."""

import numpy as np
import pytest
from rendered_toy import ToyPlan, chunks_rendered, contents

from sextant.data.rendered import open_store, repair_store, verify_store
from sextant.errors import UserError


def flip(path, position):
    with path.open("r+b") as file:
        file.seek(position)
        (byte,) = file.read(1)
        file.seek(position)
        file.write(bytes([byte ^ 1]))


@pytest.fixture
def full(tmp_path):
    store = open_store(ToyPlan(log=tmp_path / "log"), tmp_path / "cache")
    store.fill()
    (tmp_path / "log").unlink()
    return store


def repaired(store, tmp_path):
    """Repair, render, and return the chunks that this rendered; the store is then as if nothing had happened."""
    repair_store(verify_store(store.directory))
    again = open_store(ToyPlan(log=tmp_path / "log"), tmp_path / "cache")
    again.fill()
    assert verify_store(store.directory).sound
    open_store(ToyPlan(), tmp_path / "whole").fill()
    assert contents(tmp_path / "cache") == contents(tmp_path / "whole")
    assert np.array_equal(again.columns["pose"], ToyPlan().columns["pose"])
    return chunks_rendered(tmp_path / "log")


def test_a_sound_store(full):
    seen = []
    report = verify_store(full.directory, lambda done, total: seen.append((done, total)))
    assert report.sound
    assert report.rendered_chunks == (0, 1, 2, 3, 4, 5)
    assert (report.missing_chunks, report.missing_items) == ((), 0)
    assert seen[-1] == (6, 6)


def test_missing_chunks_are_no_damage(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    store.read("image", 20)
    report = verify_store(store.directory)
    assert report.sound
    assert report.missing_chunks == (0, 1, 2, 3, 4)
    assert report.missing_items == 20


@pytest.mark.parametrize(("array", "item_bytes"), [("image", 90), ("depth", 4)])
def test_a_flipped_bit_is_found_and_only_its_chunk_is_rendered_again(array, item_bytes, full, tmp_path):
    flip(full.directory / f"{array}.npy", 128 + 9 * item_bytes)
    (damage,) = verify_store(full.directory).damaged_chunks
    assert (damage.array, damage.chunk, damage.start, damage.stop) == (array, 2, 8, 12)
    assert repaired(full, tmp_path) == [8]


def test_a_short_file_loses_its_end_alone(full, tmp_path):
    path = full.directory / "image.npy"
    with path.open("r+b") as file:
        file.truncate(128 + 90 * 17)
    report = verify_store(full.directory)
    assert [damage.chunk for damage in report.damaged_chunks] == [4, 5]
    assert "bytes long, should be" in report.damaged_files[0].what
    assert repaired(full, tmp_path) == [16, 20]


def test_a_long_file_is_cut(full, tmp_path):
    with (full.directory / "image.npy").open("ab") as file:
        file.write(b"more")
    assert not verify_store(full.directory).damaged_chunks
    assert repaired(full, tmp_path) == []


@pytest.mark.parametrize("spoil", [lambda path: path.unlink(), lambda path: path.write_bytes(b"no array")])
def test_a_lost_array_is_rendered_anew(spoil, full, tmp_path):
    spoil(full.directory / "depth.npy")
    assert repaired(full, tmp_path) == [0, 4, 8, 12, 16, 20]


@pytest.mark.parametrize("spoil", [lambda path: path.unlink(), lambda path: flip(path, 130)])
def test_a_lost_column_is_written_anew_and_nothing_is_rendered(spoil, full, tmp_path):
    spoil(full.directory / "columns" / "pose.npy")
    (damage,) = verify_store(full.directory).damaged_files
    assert damage.path.name == "pose.npy"
    assert repaired(full, tmp_path) == []


@pytest.mark.parametrize("spoil", [lambda path: path.unlink(), lambda path: path.write_text("{")])
def test_a_lost_manifest_is_written_anew_and_nothing_is_rendered(spoil, full, tmp_path):
    spoil(full.directory / "manifest.json")
    report = verify_store(full.directory)
    assert report.manifest is None
    assert not report.sound
    assert repaired(full, tmp_path) == []


def test_an_array_deleted_with_the_manifest_is_not_believed_to_be_rendered(full, tmp_path):
    (full.directory / "manifest.json").unlink()
    (full.directory / "image.npy").unlink()
    assert repaired(full, tmp_path) == [0, 4, 8, 12, 16, 20]


def test_a_line_of_the_journal_that_is_nonsense_costs_its_chunk_alone(full, tmp_path):
    journal = full.directory / "journal.jsonl"
    lines = journal.read_text().splitlines()
    lines[3] = "\0" * 20
    lines[1] = lines[1].replace('"chunk":1', '"chunk":77')
    journal.write_text("\n".join(lines) + "\n")
    assert verify_store(full.directory).missing_chunks == (1, 3)
    assert repaired(full, tmp_path) == [4, 12]


def test_a_folder_in_place_of_the_journal_is_told(full):
    journal = full.directory / "journal.jsonl"
    journal.unlink()
    journal.mkdir()
    with pytest.raises(UserError, match=r"journal\.jsonl is a folder"):
        verify_store(full.directory)


def test_a_folder_that_is_no_store(tmp_path):
    with pytest.raises(UserError, match="not a rendered dataset"):
        verify_store(tmp_path)
