"""A full or forbidden disk ends with one message, and the same call resumes."""

import errno
import multiprocessing
import resource
import shutil
import sys
from collections import namedtuple

import pytest
from rendered_toy import ToyPlan, contents

from sextant.data.rendered import disk, open_store, rendering, verify_store
from sextant.data.rendered.disk import DiskFullError, readable
from sextant.errors import UserError

Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_disk_that_fills_up_keeps_what_was_rendered(number, threads, tmp_path, monkeypatch):
    store = open_store(ToyPlan(), tmp_path / "cache")
    write, written = rendering.write_at, []

    def full_at_the_fifth(path, offset, values):
        written.append(path)
        if len(written) > 5:
            path.open("r+b").close()
            raise OSError(number, "no space")
        return write(path, offset, values)

    monkeypatch.setattr(rendering, "write_at", full_at_the_fifth)
    with pytest.raises(DiskFullError) as caught:
        store.fill(threads=threads)
    said = str(caught.value)
    assert str(store.directory) in said
    assert "more" in said
    assert "is free" in said
    assert "repeat the command: it resumes" in said
    monkeypatch.undo()
    kept = store.rendered
    assert kept <= 8
    assert verify_store(store.directory).sound
    assert store.fill() == 22 - kept
    open_store(ToyPlan(), tmp_path / "whole").fill()
    assert contents(tmp_path / "cache") == contents(tmp_path / "whole")


def test_space_is_checked_before_rendering_by_what_holes_will_take(tmp_path, monkeypatch):
    plan = ToyPlan(400, shape=(64, 64, 3), log=tmp_path / "log")
    store = open_store(plan, tmp_path / "cache")
    store.read("image", slice(0, 200))
    (tmp_path / "log").unlink()
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda path: Usage(10**9, 10**9, 10**6))
    with pytest.raises(DiskFullError, match=r"needs 2\.5 MB more, 1\.0 MB is free"):
        store.fill()
    assert not (tmp_path / "log").exists()
    monkeypatch.setattr(disk.shutil, "disk_usage", lambda path: Usage(10**9, 10**9, 3 * 10**6))
    assert store.fill() == 200


def lay_out_with_little_room(cache, queue):
    sys.dont_write_bytecode = True  # Python would cut that of what is imported, without a word
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
    try:
        open_store(ToyPlan(), cache)
    except UserError as error:
        queue.put(str(error))


def test_a_file_size_limit_is_told_as_a_full_disk(tmp_path):
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=lay_out_with_little_room, args=(tmp_path / "cache", queue))
    process.start()
    said = queue.get(timeout=60)
    process.join()
    assert "the disk is full" in said
    assert "needs 2.1 kB more" in said
    assert open_store(ToyPlan(), tmp_path / "cache").fill() == 22


def test_a_journal_that_cannot_be_appended_to_is_left_whole(tmp_path, monkeypatch):
    store = open_store(ToyPlan(), tmp_path)
    store.read("image", 0)
    journal = store.directory / "journal.jsonl"
    before = journal.read_bytes()

    def full(descriptor):
        raise OSError(errno.ENOSPC, "no space")

    monkeypatch.setattr("sextant.data.rendered.journal.os.fsync", full)
    monkeypatch.setattr(rendering, "write_at", lambda path, offset, values: "")
    with pytest.raises(DiskFullError):
        store.read("image", 21)
    assert journal.read_bytes() == before


@pytest.mark.parametrize("cache", ["/proc/sextant", "{file}/cache"])
def test_a_cache_that_cannot_be_written_to_is_one_message(cache, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot be written to") as caught:
        open_store(ToyPlan(), cache.format(file=tmp_path / "file"))
    assert "paths.cache=/path" in caught.value.fix


def test_a_complete_store_needs_no_writing(tmp_path, monkeypatch):
    open_store(ToyPlan(), tmp_path).fill()
    shutil.rmtree(tmp_path / ".locks")
    store = open_store(ToyPlan(), tmp_path)
    store.read("image", slice(None))
    store.fill()
    assert not (tmp_path / ".locks").exists()


@pytest.mark.parametrize(
    ("size", "said"), [(0, "0 bytes"), (999, "999 bytes"), (2140, "2.1 kB"), (3.2e9, "3.2 GB"), (4e15, "4,000.0 TB")]
)
def test_sizes_for_people(size, said):
    assert readable(size) == said
