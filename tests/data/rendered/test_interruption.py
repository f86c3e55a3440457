"""kill -9 and a second process: nothing is lost, and nothing is rendered twice."""

import multiprocessing
import os
import random
import signal
import time

import numpy as np
import pytest
from rendered_toy import ToyPlan, chunks_rendered, contents, fill, read_item

from sextant.data.rendered import open_store, verify_store

CHUNKS = [0, 4, 8, 12, 16, 20]


@pytest.fixture(scope="module")
def context():
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["rendered_toy"])
    return context


def wait_until(true, timeout_s=60):
    deadline = time.monotonic() + timeout_s
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.005)


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 3])
def test_killed_at_random_moments_it_ends_as_if_it_had_not_been(threads, context, tmp_path):
    options = {"count": 120, "pause_s": 0.01, "log": tmp_path / "log"}
    rng = random.Random(threads)
    open_store(ToyPlan(**options), tmp_path / "whole").fill(threads=3)
    kills = 0
    options["log"] = tmp_path / "killed log"
    for _ in range(12):
        process = context.Process(target=fill, args=(tmp_path / "killed", options, threads))
        before = len(chunks_rendered(options["log"]))
        process.start()
        wait_until(lambda p=process, n=before: len(chunks_rendered(options["log"])) > n or not p.is_alive())
        time.sleep(rng.uniform(0, 0.08))
        if process.is_alive():
            os.kill(process.pid, signal.SIGKILL)
            kills += 1
        process.join()
    store = open_store(ToyPlan(**options), tmp_path / "killed")
    assert kills >= 3
    store.fill(threads=threads)
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")
    assert verify_store(store.directory).sound
    assert (
        len(chunks_rendered(options["log"])) <= 30 + (kills + 1) * threads
    )  # each kill costs no more than is under way


def test_killed_while_it_is_laid_out_it_is_laid_out_again(tmp_path):
    class Killed(ToyPlan):
        def columns(self):
            raise KeyboardInterrupt

        columns = property(columns)

    with pytest.raises(KeyboardInterrupt):
        open_store(Killed(), tmp_path)
    leftover = tmp_path / f"toy-{ToyPlan().digest[:8]}" / ".image.npy.1.tmp"
    leftover.parent.mkdir(exist_ok=True)
    leftover.touch()
    open_store(ToyPlan(), tmp_path).fill()
    assert not leftover.exists()


@pytest.mark.slow
def test_two_processes_render_once(context, tmp_path):
    options, waits = {"pause_s": 0.2, "log": tmp_path / "log"}, tmp_path / "waits"
    first = context.Process(target=fill, args=(tmp_path / "cache", options))
    first.start()
    wait_until(lambda: chunks_rendered(tmp_path / "log"))
    second = context.Process(target=fill, args=(tmp_path / "cache", options, 1, waits))
    second.start()
    second.join(60)
    first.join(60)
    assert (first.exitcode, second.exitcode) == (0, 0)
    assert chunks_rendered(tmp_path / "log") == CHUNKS
    assert f"waiting for process {first.pid} on " in waits.read_text()
    assert open_store(ToyPlan(), tmp_path / "cache").complete


def test_a_reader_goes_on_as_soon_as_its_item_is_there(context, tmp_path):
    options = {"count": 400, "pause_s": 0.05, "log": tmp_path / "log"}
    first = context.Process(target=fill, args=(tmp_path / "cache", options))
    first.start()
    wait_until(lambda: chunks_rendered(tmp_path / "log"))
    queue = context.Queue()
    second = context.Process(target=read_item, args=(tmp_path / "cache", options, 30, queue))
    second.start()
    found = queue.get(timeout=60)
    assert first.is_alive()
    os.kill(first.pid, signal.SIGKILL)
    first.join()
    second.join()
    assert np.array_equal(found, ToyPlan().render(30, 31)["image"][0])
    assert chunks_rendered(tmp_path / "log").count(28) == 1


def test_the_one_that_waits_goes_on_when_the_other_is_killed(context, tmp_path):
    options, waits = {"count": 400, "pause_s": 0.1, "log": tmp_path / "log"}, tmp_path / "waits"
    first = context.Process(target=fill, args=(tmp_path / "cache", options))
    first.start()
    wait_until(lambda: chunks_rendered(tmp_path / "log"))
    second = context.Process(target=fill, args=(tmp_path / "cache", options | {"pause_s": 0.0}, 1, waits))
    second.start()
    wait_until(lambda: waits.exists() and waits.read_text())
    os.kill(first.pid, signal.SIGKILL)
    first.join()
    second.join(60)
    assert second.exitcode == 0
    assert open_store(ToyPlan(400), tmp_path / "cache").complete
    assert len(chunks_rendered(tmp_path / "log")) <= 100 + 1
