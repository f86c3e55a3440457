"""No damaged file of weights is used: every flipped byte of a sealed one is told, and of others what a CRC can tell."""

import io
import zipfile
from contextlib import suppress

import pytest
import torch
from fuzzing import fuzz
from hypothesis import given, settings
from hypothesis import strategies as st

from sextant.errors import UserError
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION, load_checkpoint
from sextant.torch_file import SEAL, load_verified, require_finite, save_sealed

STATE = {"network.weight": torch.arange(60.0).reshape(6, 10), "network.bias": torch.linspace(-1, 1, 6)}
CONTENT = {
    KEY: {
        "schema_version": SCHEMA_VERSION,
        "task": "classification",
        "config": {"seed": 3},
        "spec": {"classes": ["a"]},
    },
    "state_dict": STATE,
    "epoch": 4,
}


def sealed(content=CONTENT):
    file = io.BytesIO()
    save_sealed(content, file)
    return file.getvalue()


def of_before(content=CONTENT):
    file = io.BytesIO()
    torch.save(content, file)
    return file.getvalue()


def same(found):
    assert found[KEY] == CONTENT[KEY]
    assert found["epoch"] == 4
    assert list(found["state_dict"]) == list(STATE)
    return all(torch.equal(found["state_dict"][name], STATE[name]) for name in STATE)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("torch_file") / "last.ckpt"


def test_a_sealed_file_is_read_by_anybody(path):
    path.write_bytes(sealed())
    assert path.read_bytes()[-64 - len(SEAL) :].startswith(SEAL)
    assert same(load_checkpoint(path))
    assert same(torch.load(path, weights_only=True))
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
    large = {"w": torch.rand(300_000)}  # in more than one piece
    path.write_bytes(sealed(large))
    assert torch.equal(load_verified(path)["w"], large["w"])


def test_the_same_contents_are_the_same_bytes():
    assert sealed() == sealed()


def test_a_file_from_before_is_read(path):
    path.write_bytes(of_before())
    assert same(load_checkpoint(path))


DAMAGE = st.lists(st.tuples(st.integers(0, 2**30), st.integers(1, 255)), min_size=1, max_size=200)


def damaged(whole, flips):
    found = bytearray(whole)
    for position, change in flips:
        found[position % len(whole)] ^= change
    return bytes(found)


@pytest.mark.slow
@fuzz
@given(flips=DAMAGE)
def test_no_flipped_byte_of_a_sealed_file_goes_unseen(path, flips):
    whole = sealed()
    if (found := damaged(whole, flips)) == whole:
        return
    path.write_bytes(found)
    with pytest.raises(UserError, match=r"last\.ckpt"):
        load_checkpoint(path)


@pytest.mark.slow
@fuzz
@given(flips=DAMAGE)
def test_a_file_from_before_with_flipped_bytes_is_refused_or_holds_what_it_held(path, flips):
    path.write_bytes(damaged(of_before(), flips))
    with suppress(UserError):
        assert same(load_checkpoint(path))


@settings(max_examples=100)
@given(kept=st.integers(0, len(sealed()) - 1), more=st.binary(max_size=100))
def test_no_part_of_a_file_is_taken_for_the_whole(path, kept, more):
    whole = sealed()
    if (found := whole[:kept] + more) == whole:
        return
    path.write_bytes(found)
    with pytest.raises(UserError, match=r"last\.ckpt"):
        load_checkpoint(path)


def test_each_single_byte_of_the_digest_counts(path):
    whole = sealed()
    for back in range(1, 64 + len(SEAL) + 3):
        found = bytearray(whole)
        found[-back] ^= 1
        path.write_bytes(found)
        with pytest.raises(UserError, match=r"last\.ckpt is damaged") as caught:
            load_checkpoint(path)
        assert "recreated by training" in caught.value.fix


def test_weights_that_are_not_finite_are_named(path):
    require_finite(STATE | {"count": torch.tensor(3), "note": "text"}, path)
    bad = STATE | {"layer.weight": torch.tensor([1.0, torch.nan]), "score": torch.tensor(-torch.inf)}
    with pytest.raises(UserError, match=r"2 of 4 arrays, the first is layer\.weight"):
        require_finite(bad, path)
    require_finite({"score": torch.tensor(torch.inf), **STATE}, path, known=set(STATE))
