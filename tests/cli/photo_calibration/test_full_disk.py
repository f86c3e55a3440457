import errno
import json
import os
import resource
import sys
from pathlib import Path

import pytest
from cli.photo_calibration.fakes import calibrate, photo

from sextant.errors import UserError

FILES = (
    "a_undistorted.jpg", "a_overlay.png", "a.json", "b_undistorted.png", "b_overlay.png", "b.json",
    "calibrations.json", "calibrations.csv", "calibrations.png",
)  # fmt: skip


@pytest.fixture
def two(tmp_path):
    return [photo(tmp_path / "a.jpg", (160, 120)), photo(tmp_path / "b.png", (160, 120))]


@pytest.mark.parametrize("number", range(len(FILES)), ids=FILES)
def test_a_disk_that_is_full_at_any_file_is_one_mistake_and_keeps_what_was_written(tmp_path, monkeypatch, two, number):
    replace = Path.replace

    def refuse(path):
        if path.name == FILES[number]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    def refusing_replace(path, target):
        refuse(target)
        return replace(path, target)

    def refusing_figure(figure, folder, name):
        refuse(folder / f"{name}.png")
        (folder / f"{name}.png").touch()

    monkeypatch.setattr(Path, "replace", refusing_replace)
    monkeypatch.setattr("sextant.figures.style.save_figure", refusing_figure)
    out = tmp_path / "out"
    with pytest.raises(UserError, match=r"output=.*the disk is full"):
        calibrate(two, out)
    assert {path.name for path in out.iterdir()} == set(FILES[:number])  # no temporary file either


@pytest.mark.slow
@pytest.mark.parametrize("limit", [100, 10_000])
def test_a_disk_that_takes_no_more_bytes(tmp_path, monkeypatch, two, limit, figures):
    """For real, by the limit on the size of files: at the straightened photo and at the overlay."""
    out = tmp_path / "out"
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # Python would cut that of what is imported, without a word
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        with pytest.raises(UserError, match="the disk is full") as raised:
            calibrate(two, out)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert raised.value.__suppress_context__  # one message, no traceback of another
    assert not list(out.glob(".*"))
    for path in out.glob("*.json"):
        json.loads(path.read_text())
    assert calibrate(two, out)  # again, with room


def test_an_output_that_is_a_file(tmp_path, two):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(UserError, match=r"output=.*is not a folder that can be written to: File exists"):
        calibrate(two, tmp_path / "out")
    assert (tmp_path / "out").read_text() == "mine"
