import sys
from types import SimpleNamespace

import pytest

from sextant.data.download import torchvision_download
from sextant.errors import UserError


def test_the_download_is_torchvisions(tmp_path, monkeypatch):
    calls = []
    datasets = SimpleNamespace(MNIST=lambda *args, **options: calls.append((args, options)))
    monkeypatch.setitem(sys.modules, "torchvision", SimpleNamespace(datasets=datasets))
    torchvision_download("MNIST", tmp_path, train=True)
    assert calls == [((str(tmp_path),), {"train": True, "download": True})]


def test_a_failed_download_says_why_and_which_dataset_needs_none(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("no route to host")

    monkeypatch.setitem(sys.modules, "torchvision", SimpleNamespace(datasets=SimpleNamespace(MNIST=fail)))
    with pytest.raises(UserError, match=f"could not download MNIST into {tmp_path}: no route to host") as caught:
        torchvision_download("MNIST", tmp_path, train=True)
    assert "dataset=digits" in caught.value.fix
