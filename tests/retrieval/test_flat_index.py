import hashlib
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sextant.atomic_files import write_sealed_json
from sextant.errors import UserError
from sextant.retrieval import nearest
from sextant.retrieval.flat_index import FlatIndex

SIMILARITIES = ("cosine", "euclidean")


def rows(count, length=8, seed=0):
    return np.random.default_rng(seed).normal(size=(count, length)).astype(np.float32)


@pytest.fixture
def saved(tmp_path):
    """A folder with an index of five named descriptors."""
    FlatIndex(rows(5), "cosine", names=[f"{i}.jpg" for i in range(5)]).save(tmp_path / "map")
    return tmp_path / "map"


@pytest.mark.parametrize("similarity", SIMILARITIES)
@given(seed=st.integers(0, 999), copies=st.integers(1, 4), block=st.integers(1, 4000), k=st.integers(1, 12))
def test_neighbours_and_values_do_not_depend_on_how_queries_are_grouped(similarity, seed, copies, block, k):
    reference = np.tile(rows(300, 20, seed), (copies, 1))
    queries = reference[:9] + 1e-4 * rows(9, 20, seed + 1)
    index = FlatIndex(reference, similarity)
    whole = index.search(queries, k)
    one_by_one = [index.search(query[None], k) for query in queries]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nearest, "BLOCK", block)
        blocks = index.search(queries, k)
    for field in range(2):
        assert np.array_equal(whole[field], blocks[field])
        assert np.array_equal(whole[field], np.concatenate([found[field] for found in one_by_one]))


@pytest.mark.parametrize("similarity", SIMILARITIES)
def test_a_saved_index_finds_the_same(similarity, tmp_path):
    index = FlatIndex(3 * rows(50), similarity, names=[str(i) for i in range(50)])
    index.save(tmp_path / "map")
    loaded = FlatIndex.load(tmp_path / "map")
    assert (loaded.similarity, loaded.names, len(loaded), loaded.dimension) == (similarity, index.names, 50, 8)
    assert not loaded.references.rows.flags.writeable
    for found, expected in zip(loaded.search(rows(9, 8, 1), 4), index.search(rows(9, 8, 1), 4), strict=True):
        assert np.array_equal(found, expected)


def test_an_index_can_be_saved_over_the_one_it_was_loaded_from(saved):
    loaded = FlatIndex.load(saved)
    loaded.save(saved)
    assert FlatIndex.load(saved).names == loaded.names
    FlatIndex(rows(3)).save(saved)
    assert (len(FlatIndex.load(saved)), FlatIndex.load(saved).names) == (3, None)


def test_a_folder_holds_no_pickle(saved):
    assert sorted(path.name for path in saved.iterdir()) == ["descriptors.npy", "index.json"]
    assert np.load(saved / "descriptors.npy", allow_pickle=False).dtype == np.float32


def test_a_change_of_any_byte_is_noticed(saved):
    path = saved / "descriptors.npy"
    whole = path.read_bytes()
    for place in (0, 10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
        with pytest.raises(UserError, match="is damaged"):
            FlatIndex.load(saved)


def test_an_altered_name_is_noticed_and_an_index_without_its_own_hash_opens(saved):
    path = saved / "index.json"
    text = path.read_text()
    path.write_text(text.replace("3.jpg", "4.jpg", 1))
    with pytest.raises(UserError, match=r"index\.json was altered"):
        FlatIndex.load(saved)
    header = json.loads(text)
    del header["seal"]
    path.write_text(json.dumps(header))
    assert FlatIndex.load(saved).names == tuple(f"{i}.jpg" for i in range(5))


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda folder: (folder / "descriptors.npy").unlink(), "descriptors.npy cannot be read"),
        (lambda folder: (folder / "descriptors.npy").write_bytes(b""), "is not the file"),
        (lambda folder: np.save(folder / "descriptors.npy", rows(4)), "is not the file"),
        (lambda folder: (folder / "index.json").unlink(), "has no index.json"),
        (lambda folder: (folder / "index.json").write_text("{"), "is not the header of an index"),
        (lambda folder: (folder / "index.json").write_text("[]"), "is not the header of an index"),
    ],
)
def test_damaged_and_foreign_folders_are_refused(saved, damage, complaint):
    damage(saved)
    with pytest.raises(UserError, match=complaint):
        FlatIndex.load(saved)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"version": 2}, "has version 2; this program reads version 1"),
        ({"format": "faiss"}, "is not the header of an index"),
        ({"similarity": "manhattan"}, "wrong kind"),
        ({"names": ["a"]}, "a name for each of the 5 descriptors; got 1"),
        ({"names": [1, 2, 3, 4, 5]}, "wrong kind"),
        ({"count": "5"}, "wrong kind"),
        ({"count": 6}, "states 6 x 8"),
        ({"sha256": None}, "wrong kind"),
    ],
)
def test_headers_that_lie_are_refused(saved, change, complaint):
    path = saved / "index.json"
    write_sealed_json(path, json.loads(path.read_text()) | change)
    with pytest.raises(UserError, match=complaint):
        FlatIndex.load(saved)


@pytest.mark.parametrize(
    ("array", "complaint"),
    [
        (np.array([{}], object), "cannot be read"),
        (np.zeros((5, 8)), "holds float64"),
        (rows(5)[:, :7], "states 5 x 8"),
        (np.full((5, 8), np.nan, np.float32), "not finite"),
    ],
)
def test_arrays_that_are_no_descriptors_are_refused_even_with_their_digest(saved, array, complaint):
    np.save(saved / "descriptors.npy", array)
    header = json.loads((saved / "index.json").read_text())
    header["sha256"] = hashlib.sha256((saved / "descriptors.npy").read_bytes()).hexdigest()
    write_sealed_json(saved / "index.json", header)
    with pytest.raises(UserError, match=complaint):
        FlatIndex.load(saved)


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with pytest.raises(UserError, match="nowhere is not a saved index: there is no such folder"):
        FlatIndex.load(tmp_path / "nowhere")


def test_names_must_be_as_many_as_descriptors():
    with pytest.raises(ValueError, match="a name for each of the 3 descriptors; got 2"):
        FlatIndex(rows(3), names=["a", "b"])


def test_joined_indexes_find_what_one_of_all_rows_finds():
    rows = np.random.default_rng(0).normal(size=(20, 6)).astype(np.float32)
    whole = FlatIndex(rows, names=list(map(str, range(20))))
    joined = FlatIndex.joined([FlatIndex(rows[:1]), FlatIndex(rows[1:12]), FlatIndex(rows[12:])], whole.names)
    assert np.array_equal(joined.references.rows, whole.references.rows)
    assert joined.names == whole.names
    found, expected = joined.search(rows[:4], 5), whole.search(rows[:4], 5)
    assert np.array_equal(found.indices, expected.indices)
    assert np.array_equal(found.values, expected.values)
    for parts in ([], [whole, FlatIndex(rows, "euclidean")], [whole, FlatIndex(rows[:, :3])]):
        with pytest.raises(ValueError, match=r"similarity|dimension"):
            FlatIndex.joined(parts)
