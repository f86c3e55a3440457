"""Leases: one holder at a time, on this host and, by age alone, among hosts that share a disk."""

import json
import multiprocessing
import os
import random
import signal
import threading
import time
from dataclasses import asdict

import pytest

from sextant import lease as module
from sextant.lease import Holder, Lease, look, take

LEASE_S = 3600.0
SPAWN = multiprocessing.get_context("spawn")


def wait_until(true, seconds=30):
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def grown_old(path, seconds):
    """As if nobody had touched it for so long."""
    stat = path.stat()
    os.utime(path, (stat.st_atime - seconds, stat.st_mtime - seconds))


@pytest.fixture
def elsewhere(monkeypatch):
    """What is held by this process looks to it as if another host held it."""
    return lambda name: monkeypatch.setattr(module, "_place", lambda: name)


def test_who_holds_it_is_named_and_giving_it_back_frees_it(tmp_path):
    first = take(tmp_path)
    assert isinstance(first, Lease)
    found = take(tmp_path)
    assert isinstance(found, Holder)
    assert (found.process, found.here) == (os.getpid(), True)
    assert look(tmp_path) == (found, True)
    first.release()
    assert look(tmp_path) is None
    again = take(tmp_path)
    assert isinstance(again, Lease)
    again.release()
    assert not list(tmp_path.iterdir())


def test_another_host_is_believed_until_it_is_silent_for_too_long(tmp_path, elsewhere):
    elsewhere("a")
    first = take(tmp_path, LEASE_S)
    elsewhere("b")
    assert isinstance(take(tmp_path, 1.0), Holder)  # the time that counts is its own, not the asker's
    grown_old(first.path, LEASE_S - 60)
    assert isinstance(take(tmp_path), Holder)
    grown_old(first.path, 120)
    assert look(tmp_path)[1] is False
    second = take(tmp_path)
    assert isinstance(second, Lease)
    assert first.taken_over()
    assert not second.taken_over()
    second.release()
    assert first.taken_over()  # also when its successor has come and gone
    first.release()
    third = take(tmp_path)
    assert isinstance(third, Lease)
    third.release()


def test_a_process_of_this_host_that_lives_keeps_it_however_long_it_is_silent(tmp_path):
    first = take(tmp_path, LEASE_S)
    grown_old(first.path, 10 * LEASE_S)
    assert isinstance(take(tmp_path), Holder)
    first.release()


def test_a_process_id_that_came_round_again_does_not_hold_it(tmp_path):
    first = take(tmp_path)
    content = json.loads(first.path.read_text())
    first.path.write_text(json.dumps(content | {"began": "1"}))
    second = take(tmp_path)
    assert isinstance(second, Lease)
    second.release()
    first.release()


def test_a_damaged_lease_is_held_by_nobody(tmp_path):
    (tmp_path / "7").write_text("{")
    grown_old(tmp_path / "7", 2 * module.WRITING_S)
    lease = take(tmp_path)
    assert isinstance(lease, Lease)
    assert lease.path.name == "8"
    lease.release()


def test_a_lease_that_is_still_being_written_is_waited_for(tmp_path, monkeypatch):
    slow, looked = tmp_path / "1", threading.Event()
    slow.touch()  # as a disk without hard links shows it, before its content

    def write(seconds):
        if not looked.is_set():
            holder = Holder("another", "another host", 1, "1", LEASE_S)
            slow.write_text(json.dumps(asdict(holder)))
            looked.set()

    monkeypatch.setattr(module.time, "sleep", write)
    assert take(tmp_path).host == "another"
    assert looked.is_set()


def test_without_proc_a_process_that_died_frees_it_too(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PROC", tmp_path / "proc")
    monkeypatch.setattr(module, "_place", module._place.__wrapped__)  # which keeps what it read before
    held = SPAWN.Event()
    process = SPAWN.Process(target=take_without_proc, args=(tmp_path, held))
    process.start()
    assert held.wait(30)
    assert look(tmp_path / "lease")[1]
    process.kill()
    while look(tmp_path / "lease")[1]:  # it is a zombie until it is joined
        process.is_alive()
    lease = take(tmp_path / "lease")
    assert isinstance(lease, Lease)
    lease.release()


def take_without_proc(folder, held):
    module.PROC = folder / "proc"
    module._place.cache_clear()
    take(folder / "lease", LEASE_S)
    held.set()
    signal.pause()


def test_a_lease_that_cannot_be_read_is_not_taken(tmp_path, monkeypatch):
    first = take(tmp_path)

    def refused(*_):
        raise PermissionError(13, "Permission denied")

    with monkeypatch.context() as patch:
        patch.setattr(module.Path, "read_text", refused)
        with pytest.raises(PermissionError):
            take(tmp_path)
    assert not first.taken_over()
    first.release()


def test_who_slept_through_two_takeovers_knows(tmp_path, elsewhere):
    elsewhere("a")
    first = take(tmp_path, LEASE_S)
    for host in "bc":
        elsewhere(host)
        grown_old(max(tmp_path.iterdir(), key=lambda path: int(path.name)), 2 * LEASE_S)
        last = take(tmp_path, LEASE_S)
        assert isinstance(last, Lease)
    for path in (first.path, first.path.with_name("2")):
        path.unlink(missing_ok=True)
    assert first.taken_over()
    assert not last.taken_over()
    last.release()


def test_a_disk_without_hard_links_does_too(tmp_path, monkeypatch):
    def refused(*given):
        raise OSError(module.NO_LINKS[0], "Operation not permitted")

    monkeypatch.setattr(os, "link", refused)
    lease = take(tmp_path)
    assert isinstance(lease, Lease)
    assert isinstance(take(tmp_path), Holder)
    assert not module._made(lease.path, look(tmp_path)[0])
    lease.release()


def test_it_is_touched_while_it_is_held(tmp_path):
    lease = take(tmp_path, lease_s=0.3)
    before = lease.path.stat().st_mtime_ns
    wait_until(lambda: lease.path.stat().st_mtime_ns > before)
    lease.release()


def test_who_took_it_is_interrupted_when_its_lease_was_taken_over(tmp_path, elsewhere):
    elsewhere("a")
    first = take(tmp_path, lease_s=0.5)
    first.path.with_name(str(int(first.path.name) + 1)).write_text("another's")
    with pytest.raises(KeyboardInterrupt):
        wait_until(lambda: False)
    assert first.lost
    first.release()
    assert first.path.exists()  # it is the other's to tidy


def hold_in_turn(folder, counter, turns, seed):
    """Take the lease again and again; in between a file must be as this process left it."""
    rng = random.Random(seed)
    for _ in range(turns):
        while not isinstance(lease := take(folder), Lease):
            time.sleep(0.001)
        value = int(counter.read_text())
        time.sleep(rng.uniform(0, 0.002))
        counter.write_text(str(value + 1))
        if rng.random() < 0.2:  # die with it: the next in turn finds a dead process
            os.kill(os.getpid(), signal.SIGKILL)
        lease.release()


def test_processes_that_come_and_go_never_hold_it_together(tmp_path):
    counter, folder = tmp_path / "counter", tmp_path / "lease"
    counter.write_text("0")
    turns = [6, 7, 8, 9]
    processes = [SPAWN.Process(target=hold_in_turn, args=(folder, counter, n, n)) for n in turns]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    expected = 0
    for n in turns:  # as each has drawn
        rng = random.Random(n)
        for _ in range(n):
            rng.uniform(0, 0.002)
            expected += 1
            if rng.random() < 0.2:
                break
    assert int(counter.read_text()) == expected
