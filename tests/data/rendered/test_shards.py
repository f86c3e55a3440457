"""A store rendered in three parts by three processes is the one that one process renders."""

import multiprocessing
import shutil

import pytest
from rendered_toy import ToyPlan, chunks_rendered, contents

from sextant.data.rendered import chunks_of, merge_shards, open_shard, open_store, verify_store
from sextant.data.rendered.layout import DamagedStoreError
from sextant.errors import ArgumentError, UserError

SHARDS = 3


def render(cache, shard, log):
    store = open_shard(ToyPlan(log=log), cache, shard, SHARDS)
    store.fill(chunks=chunks_of(store, shard, SHARDS))


@pytest.mark.slow
def test_three_processes_and_a_merge_render_what_one_does(tmp_path):
    context, log = multiprocessing.get_context("forkserver"), tmp_path / "log"
    processes = [context.Process(target=render, args=(tmp_path / "cache", shard, log)) for shard in range(SHARDS)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
        assert process.exitcode == 0
    assert sorted(chunks_rendered(log)) == [0, 4, 8, 12, 16, 20]  # each by one of them
    store, copied = merge_shards(ToyPlan(log=log), tmp_path / "cache", SHARDS)
    assert (copied, store.complete, verify_store(store.directory).sound) == (22, True, True)
    assert len(chunks_rendered(log)) == 6
    open_store(ToyPlan(), tmp_path / "whole").fill()
    shutil.rmtree(tmp_path / "cache" / "shards")
    assert contents(tmp_path / "cache") == contents(tmp_path / "whole")


def test_a_shard_that_is_lost_is_named_and_is_all_that_is_repeated(tmp_path):
    cache, log = tmp_path / "cache", tmp_path / "log"
    for shard in (0, 2):
        render(cache, shard, None)
    with pytest.raises(UserError, match=r"toy: shard 1 lacks 2 of 2 chunks\nRender what is missing: shards=3 shard=1"):
        merge_shards(ToyPlan(), cache, SHARDS)
    assert open_store(ToyPlan(), cache).rendered == 0
    for shard in range(SHARDS):
        render(cache, shard, log)
    assert sorted(chunks_rendered(log)) == [4, 16]
    assert merge_shards(ToyPlan(), cache, SHARDS)[1] == 22
    shutil.rmtree(cache / "shards")
    assert merge_shards(ToyPlan(), cache, SHARDS)[1] == 0  # they are not needed any more


def test_a_damaged_shard_is_not_merged(tmp_path):
    for shard in range(SHARDS):
        render(tmp_path, shard, None)
    path = next((tmp_path / "shards" / "1_of_3").glob("toy-*/image.npy"))
    content = bytearray(path.read_bytes())
    content[128 + 90 * 4] ^= 1
    path.write_bytes(content)
    with pytest.raises(DamagedStoreError, match=r"1_of_3/.*image\.npy.*items 4 to 7 are not those that were rendered"):
        merge_shards(ToyPlan(), tmp_path, SHARDS)


def test_there_is_no_shard_beyond_the_last(tmp_path):
    with pytest.raises(ArgumentError, match="shard=3: there are shards 0 to 2"):
        open_shard(ToyPlan(), tmp_path, 3, SHARDS)
