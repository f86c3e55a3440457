"""Arrays of any size come back from a state dict."""

import pytest
import torch
from torch import nn

from sextant.chapters.cosfire.learnt_later import LearntLater

ARRAYS = {
    "weights": torch.randn(3, 5, dtype=torch.float64),
    "labels": torch.tensor([4, 2]),
    "images": torch.ones(2, 1, 4, 4).byte(),
}


def made():
    return nn.ModuleDict({"kept": LearntLater(*ARRAYS), "other": nn.Linear(2, 2)})


def test_what_was_kept_comes_back_in_its_size_and_type(tmp_path):
    module = made()
    module["kept"].keep(**ARRAYS)
    torch.save(module.state_dict(), tmp_path / "state")
    other = made()
    other.load_state_dict(torch.load(tmp_path / "state", weights_only=True))
    for name, array in ARRAYS.items():
        assert torch.equal(other["kept"][name], array)
        assert other["kept"][name].dtype == array.dtype


def test_nothing_kept_yet_takes_the_place_of_something():
    full = made()
    full["kept"].keep(**ARRAYS)
    full.load_state_dict(made().state_dict())
    assert all(full["kept"][name].numel() == 0 for name in ARRAYS)


def test_arrays_are_no_parameters_and_unknown_names_are_refused():
    kept = LearntLater("weights")
    assert list(kept.parameters()) == []
    with pytest.raises(AttributeError):
        kept["labels"]


def test_a_state_without_an_array_is_refused():
    state = made().state_dict()
    del state["kept.labels"]
    with pytest.raises(RuntimeError, match=r"kept\.labels"):
        made().load_state_dict(state)
