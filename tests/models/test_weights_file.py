"""Weights of other people's files: what is not one is told in one line of ours."""

import os
import pickle
from functools import partial

import pytest
import torch
from torch import nn

from sextant.errors import UserError
from sextant.models import load_published
from sextant.models.weights_file import load_weights
from sextant.runs.checkpoint import load_checkpoint


class Payload:
    def __reduce__(self):
        return os.mkdir, ("executed",)


READERS = [load_checkpoint, load_published, partial(load_weights, nn.Linear(2, 2))]


@pytest.mark.parametrize("read", READERS, ids=["checkpoint", "published", "weights"])
@pytest.mark.parametrize("legacy", [False, True], ids=["zip", "legacy"])
@pytest.mark.parametrize("content", [Payload(), {"state_dict": nn.Linear(1, 1)}], ids=["call", "module"])
def test_a_refusal_names_what_the_file_would_call_and_gives_no_advice_to_let_it(tmp_path, read, legacy, content):
    path = tmp_path / "weights.pth"
    torch.save(content, path, _use_new_zipfile_serialization=not legacy)
    with pytest.raises(UserError) as caught:
        read(path)
    said = str(caught.value)
    assert str(path) in said
    assert "it would call " in said
    assert "weights_only" not in said
    assert "PyTorch" not in said
    assert not os.path.exists("executed")


@pytest.mark.parametrize("read", READERS, ids=["checkpoint", "published", "weights"])
def test_a_plain_pickle_is_refused_in_one_line(tmp_path, read):
    path = tmp_path / "weights.pth"
    path.write_bytes(pickle.dumps(Payload(), protocol=5))
    with pytest.raises(UserError) as caught:
        read(path)
    assert "weights_only" not in str(caught.value)
    assert "Re-running" not in str(caught.value)
