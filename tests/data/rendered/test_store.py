"""A store renders what is read, once, and keeps it."""

import json
import pickle
import threading
import tracemalloc

import numpy as np
import pytest
from rendered_toy import ToyPlan, chunks_rendered, contents

from sextant.data.rendered import (
    forget_chunks,
    load_store,
    modules_sha256,
    open_store,
    repair_store,
    splits,
    verify_store,
)
from sextant.data.rendered import store as store_module
from sextant.data.rendered.layout import DamagedStoreError
from sextant.errors import UserError


def image(index, plan):
    return plan.render(index, index + 1)["image"][0]


def test_reading_an_item_renders_its_chunk_alone(tmp_path):
    log = tmp_path / "log"
    store = open_store(ToyPlan(log=log), tmp_path / "cache")
    assert (len(store), store.rendered, store.complete) == (22, 0, False)
    assert np.array_equal(store.read("image", 9), image(9, ToyPlan()))
    assert chunks_rendered(log) == [8]
    assert store.rendered == 4
    assert store.read("depth", [21, 8, -1]).tolist() == [21, 8, 21]
    assert chunks_rendered(log) == [8, 20]
    assert store.rendered == 6  # the last chunk is short
    store.read("image", slice(0, 22, 5))
    assert sorted(chunks_rendered(log)) == [0, 4, 8, 12, 20]
    assert not store.complete
    assert store.fill() == 4
    assert store.complete
    assert store.fill() == 0
    assert sorted(chunks_rendered(log)) == [0, 4, 8, 12, 16, 20]


def test_every_way_to_index(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    everything = store.read("image", slice(None))
    mask = np.arange(22) % 3 == 0
    for indices in (3, -2, np.int32(7), [4, 4, 1], np.array([[1, 2], [3, -4]]), slice(2, 20, 3), mask, []):
        expected = everything[np.asarray(indices, dtype=int) if isinstance(indices, list) else indices]
        assert np.array_equal(store.read("image", indices), expected)
        assert np.array_equal(store.read("pose", indices), store.columns["pose"][np.arange(22)[indices]]) or not indices
    item = store[5]
    assert sorted(item) == ["depth", "image", "pose"]
    assert item["depth"] == 5
    for wrong in (22, -23, [0, 99], 1.5):
        with pytest.raises(IndexError):
            store.read("image", wrong)
    with pytest.raises(KeyError, match="arrays are image, depth, pose"):
        store.read("pixels", 0)


def test_what_is_read_is_a_copy(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    found = store.read("image", 0)
    found += 1
    assert not np.array_equal(found, store.read("image", 0))


def test_a_complete_store_opens_without_the_world(tmp_path):
    open_store(ToyPlan(), tmp_path).fill()
    plan = ToyPlan()
    store = open_store(plan, tmp_path)
    assert store.complete
    assert store.read("depth", 13) == 13
    assert store.columns["pose"][1].tolist() == [3, 4, 5]
    assert store.facts["splits"] == {"train": 20, "test": 2}
    assert not plan.world_built


def test_a_changed_config_or_renderer_goes_elsewhere(tmp_path):
    first = open_store(ToyPlan(), tmp_path)
    other = open_store(ToyPlan(salt=1), tmp_path)
    changed = ToyPlan()
    changed.source_sha256 = "1" * 64
    third = open_store(changed, tmp_path)
    assert len({first.directory, other.directory, third.directory}) == 3
    assert not np.array_equal(first.read("image", 0), other.read("image", 0))


@pytest.mark.parametrize("threads", [2, 5])
def test_any_number_of_threads_gives_the_same_bytes(threads, tmp_path):
    open_store(ToyPlan(), tmp_path / "one").fill()
    log = tmp_path / "log"
    seen = []
    store = open_store(ToyPlan(log=log), tmp_path / "several")
    store.fill(lambda done, total: seen.append((done, total)), threads)
    assert contents(tmp_path / "one") == contents(tmp_path / "several")
    assert sorted(chunks_rendered(log)) == [0, 4, 8, 12, 16, 20]
    assert seen[0] == (0, 22)
    assert seen[-1] == (22, 22)
    assert [done for done, _ in seen] == sorted(done for done, _ in seen)


def test_threads_of_one_process_render_each_chunk_once(tmp_path):
    log = tmp_path / "log"
    store = open_store(ToyPlan(log=log, pause_s=0.01), tmp_path / "cache")
    others = [threading.Thread(target=store.read, args=("image", slice(i, None, 4))) for i in range(4)]
    for thread in others:
        thread.start()
    for thread in others:
        thread.join()
    assert sorted(chunks_rendered(log)) == [0, 4, 8, 12, 16, 20]


def test_an_error_of_the_renderer_is_passed_on_and_keeps_what_was_rendered(tmp_path):
    class Failing(ToyPlan):
        def render(self, start, stop):
            if start == 12:
                raise FileNotFoundError("texture.png")
            return super().render(start, stop)

    store = open_store(Failing(), tmp_path)
    with pytest.raises(FileNotFoundError, match="texture"):
        store.fill()
    assert store.rendered == 12
    assert open_store(ToyPlan(), tmp_path).fill() == 10


@pytest.mark.parametrize(
    "made",
    [
        {"image": np.zeros((4, 6, 5, 3), "u1")},
        {"image": np.zeros((4, 6, 5, 3), "i8"), "depth": np.zeros(4, "f4")},
        {"image": np.zeros((3, 6, 5, 3), "u1"), "depth": np.zeros(4, "f4")},
    ],
)
def test_a_renderer_that_makes_something_else_is_told(made, tmp_path):
    plan = ToyPlan()
    plan.render = lambda start, stop: made
    with pytest.raises(ValueError, match="planned"):
        open_store(plan, tmp_path).fill()


def test_a_store_without_its_renderer_reads_what_is_there(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    store.read("image", 0)
    alone = load_store(store.directory)
    assert alone.read("depth", 3) == 3
    with pytest.raises(UserError, match="4 of 22 items are rendered") as caught:
        alone.read("image", 4)
    assert "sextant data render dataset=toy" in str(caught.value)


def test_a_pickled_store_is_the_same_store(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    store.read("image", 0)
    packed = pickle.dumps(store)
    again = pickle.loads(packed)
    assert len(packed) < 2000
    assert again.rendered == 4
    assert np.array_equal(again.read("image", 20), store.read("image", 20))


def test_memory_holds_chunks_and_never_the_whole(tmp_path):
    shape, count = (64, 64, 3), 400  # 4.9 MB of images
    plan = ToyPlan(count, shape=shape)
    plan.render = lambda start, stop: {
        "image": np.full((stop - start, *shape), start % 256, "u1"),
        "depth": np.zeros(stop - start, "f4"),
    }
    tracemalloc.start()
    store = open_store(plan, tmp_path)
    store.fill(threads=2)
    for index in range(0, count, 7):
        store.read("image", index)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e6


def test_an_unrendered_store_takes_no_space(tmp_path):
    store = open_store(ToyPlan(2000, shape=(64, 64, 3)), tmp_path)
    path = store.directory / "image.npy"
    assert path.stat().st_size > 24e6
    assert path.stat().st_blocks * 512 < 1e5


def test_a_torn_last_line_is_ignored_then_cut(tmp_path):
    log = tmp_path / "log"
    store = open_store(ToyPlan(log=log), tmp_path / "cache")
    store.fill()
    journal = store.directory / "journal.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:-1]) + lines[-1][: len(lines[-1]) // 2])
    store = open_store(ToyPlan(log=log), tmp_path / "cache")
    assert store.rendered == 20
    store.fill()
    assert [json.loads(line)["chunk"] for line in journal.read_text().splitlines()] == [0, 1, 2, 3, 4, 5]
    assert chunks_rendered(log) == [0, 4, 8, 12, 16, 20, 20]


def test_the_chunk_size_of_a_begun_store_stays(tmp_path):
    open_store(ToyPlan(), tmp_path).read("image", 0)
    plan = ToyPlan()
    plan.chunk = 7
    store = open_store(plan, tmp_path)
    store.fill()
    open_store(ToyPlan(), tmp_path / "whole").fill()
    assert store.manifest.chunk == 4
    assert (store.directory / "image.npy").read_bytes() == contents(tmp_path / "whole")["image.npy"]


@pytest.mark.parametrize(
    ("name", "spoil", "said"),
    [
        ("image.npy", lambda p: p.write_bytes(p.read_bytes()[:-1]), "bytes long, should be"),
        ("image.npy", lambda p: p.unlink(), "the file is missing"),
        ("image.npy", lambda p: np.save(p, np.zeros((22, 6, 5), "u1")), "the manifest requires uint8"),
        ("depth.npy", lambda p: p.write_bytes(b"nonsense"), "not an array file"),
        ("manifest.json", lambda p: p.write_text("{"), "the manifest cannot be read"),
        ("manifest.json", lambda p: p.write_text(p.read_text().replace('"salt": 0', '"salt": 1')), "was altered"),
        ("manifest.json", lambda p: p.write_text("[]"), "the manifest cannot be read"),
    ],
)
def test_a_damaged_file_is_named_with_what_to_do(name, spoil, said, tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    spoil(store.directory / name)
    with pytest.raises(DamagedStoreError, match=said) as caught:
        open_store(ToyPlan(), tmp_path)
    assert str(store.directory / name) in caught.value.problem
    assert f"sextant data verify {store.directory} repair=true" in caught.value.fix


def test_a_store_of_another_plan_is_not_taken(tmp_path):
    other = open_store(ToyPlan(salt=1), tmp_path)
    other.directory.rename(other.directory.with_name(f"toy-{ToyPlan().digest[:8]}"))
    with pytest.raises(DamagedStoreError, match="the config requires"):
        open_store(ToyPlan(), tmp_path)


def test_an_altered_column_is_told(tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    np.save(store.directory / "columns" / "pose.npy", np.zeros((22, 3)))
    with pytest.raises(DamagedStoreError, match="does not match its hash") as caught:
        _ = store.columns
    assert f"sextant data verify {store.directory} repair=true" in caught.value.fix


@pytest.mark.parametrize("array", ["image", "depth"])
def test_an_altered_item_is_told_when_it_is_read_and_no_sooner(array, tmp_path):
    store = open_store(ToyPlan(), tmp_path)
    store.fill()
    path = store.directory / f"{array}.npy"
    with path.open("r+b") as file:
        file.seek(-1, 2)
        last = file.read(1)[0]
        file.seek(-1, 2)
        file.write(bytes([last ^ 1]))
    opened = open_store(ToyPlan(), tmp_path)
    assert len(opened.mapped(array, np.arange(20), threads=2)) == 22  # items 20 and 21 lie in the last chunk
    for ask in (lambda: opened.read(array, 20), lambda: opened[21], lambda: opened.mapped(array, np.arange(22))):
        with pytest.raises(DamagedStoreError, match="items 20 to 21 are not those that were rendered") as caught:
            ask()
        assert str(path) in caught.value.problem
        assert f"sextant data verify {store.directory} repair=true" in caught.value.fix
    repair_store(verify_store(store.directory))
    assert np.array_equal(open_store(ToyPlan(), tmp_path).read("image", 21), image(21, ToyPlan()))


def test_each_chunk_is_compared_with_its_hash_once(tmp_path, monkeypatch):
    store, read = open_store(ToyPlan(), tmp_path), []
    hashed = store_module.part_sha256
    monkeypatch.setattr(store_module, "part_sha256", lambda *given: read.append(given) or hashed(*given))
    for _ in range(3):
        store.read("image", [0, 1, 9])
    assert len(read) == 2


def test_a_forgotten_chunk_is_rendered_anew(tmp_path):
    log = tmp_path / "log"
    store = open_store(ToyPlan(log=log), tmp_path / "cache")
    store.fill()
    forget_chunks(store.directory, [2])
    assert open_store(ToyPlan(log=log), tmp_path / "cache").fill() == 4
    assert chunks_rendered(log)[-1] == 8


@pytest.mark.parametrize(
    "parts", [{"chunk": 0}, {"columns": {"pose": np.zeros(3)}}, {"columns": {"depth": np.ones(22)}}]
)
def test_a_plan_that_contradicts_itself_is_told(parts, tmp_path):
    plan = ToyPlan()
    for name, value in parts.items():
        setattr(plan, name, value)
    with pytest.raises(ValueError, match="toy: "):
        open_store(plan, tmp_path)


def test_a_plan_without_items_is_a_mistake_of_the_user(tmp_path):
    with pytest.raises(UserError, match="no item"):
        open_store(ToyPlan(0), tmp_path)


def test_the_hash_of_source_changes_with_the_source(tmp_path, monkeypatch):
    package = tmp_path / "painted"
    (package / "deep").mkdir(parents=True)
    (package / "__init__.py").write_text("raise RuntimeError('not run')\n")
    (package / "deep" / "brush.py").write_text("SIZE = 1\n")
    monkeypatch.syspath_prepend(tmp_path)
    before = modules_sha256("painted", "rendered_toy")
    modules_sha256.__globals__["_modules_sha256"].cache_clear()
    (package / "deep" / "brush.py").write_text("SIZE = 2\n")
    after = modules_sha256("painted", "rendered_toy")
    assert after != before
    monkeypatch.setattr(splits, "SAME_BYTES", (after, before))  # it is known to render the same
    modules_sha256.__globals__["_modules_sha256"].cache_clear()
    assert modules_sha256("painted", "rendered_toy") == before
    with pytest.raises(ModuleNotFoundError):
        modules_sha256("nowhere")
