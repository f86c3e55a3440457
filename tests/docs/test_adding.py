"""The examples of ``docs/adding.md``, as they are written there: their files are saved, then the last block runs."""

import re
import sys
from importlib import import_module

import numpy as np
import pytest
import tiny_places
from docs_commands import ROOT

PAGE = (ROOT / "docs" / "adding.md").read_text()
#: heading of a section -> its blocks
SECTIONS = {
    text.partition("\n")[0]: re.findall(r"^```(?:python|yaml)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    for text in PAGE.split("\n## ")[1:]
}
EXAMPLES = [heading for heading, blocks in SECTIONS.items() if blocks]


@pytest.fixture(scope="module")
def libraries():
    """What every run imports, once for all examples."""
    import_module("sextant.lifecycle.training")


@pytest.fixture
def desk(libraries, tmp_path, monkeypatch):
    """A working directory on the import path, with photos by day and by night, and what the page takes for granted."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("SEXTANT_OUTPUTS", str(tmp_path / "outputs"))
    before = set(sys.modules)
    for k, split in enumerate(("train", "val", "test")):
        for light in ("day", "night"):
            tiny_places.ride(tmp_path / "places" / split / light, range(20 * k, 20 * k + 12), night=light == "night")
    poses = np.column_stack([np.arange(24.0), np.zeros(24), np.zeros(24)])
    yield {"drive_images": np.random.default_rng(0).integers(0, 256, (24, 12, 16, 3), np.uint8), "drive_poses": poses}
    for name in set(sys.modules) - before:
        if name.startswith("my_"):
            del sys.modules[name]


def test_each_kind_of_addition_has_an_example():
    assert EXAMPLES == ["A loss", "A corruption", "A GP model", "A dataset"]


@pytest.mark.slow
@pytest.mark.parametrize("heading", EXAMPLES)
def test_an_addition_runs_as_it_is_written(heading, desk, tmp_path):
    *files, run = SECTIONS[heading]
    for text in files:
        path = tmp_path / re.match(r"# (\S+\.(py|yaml))\n", text)[1]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    exec(run, desk)
    if "outcome" in desk:
        assert desk["outcome"].status == "finished"
        assert all(np.isfinite(value) for value in desk["outcome"].metrics.values())


def test_the_parts_of_the_package_that_the_page_names_are_there():
    for path in re.findall(r"`((?:chapters|kit|config|data|cli|localization)/[\w/]+\.py)`", PAGE):
        assert (ROOT / "src" / "sextant" / path).is_file(), path
