"""What ``make gpu-check`` writes, and what it says without a GPU."""

import pytest
import torch

from benchmarks import gpu_check

TESTS = """
import os, pathlib, signal, threading
LOG = pathlib.Path(os.environ["SEXTANT_TEST_LOG"])
def test_one(): assert LOG.parent.is_dir()
def test_two(): assert not LOG.parent.is_dir()
def test_three():
    while not LOG.is_file() or LOG.read_text().count("::") < 2:
        threading.Event().wait(0.05)
    os.kill(os.getppid(), signal.SIGTERM)  # as when time is up
    signal.pause()
"""


@pytest.mark.slow
def test_what_has_run_is_known_when_time_is_up(tmp_path, monkeypatch):
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)  # the tests below are not those of a worker of this suite
    (tmp_path / "test_some.py").write_text(TESTS)
    (tmp_path / "pytest.ini").write_text("[pytest]")
    tests = gpu_check.run_tests(str(tmp_path / "test_some.py"))
    assert {name.partition("::")[2]: outcome for name, outcome, _ in tests} == {
        "test_one": "passed",
        "test_two": "failed",
    }


def test_the_page_has_every_test_and_every_timing():
    tests = [
        ("tests.a::test_one", "passed", "1.5"),
        ("tests.a::test_two", "failed", "0.1"),
        ("tests.b::a", "skipped", "0.0"),
    ]
    timings = [("ResNet-20", "bf16", "9,000 images/s", "CPU, 32: 300 images/s", "30.0")]
    page = gpu_check.page(tests, timings, "a GPU", 123.4)
    assert "in 123 s on a GPU" in page
    assert "1 passed, 1 failed, 1 skipped" in page
    assert "| tests.a::test_two | failed | 0.1 |" in page
    assert "| ResNet-20 | bf16 | 9,000 images/s | CPU, 32: 300 images/s | 30.0 |" in page


def test_without_a_gpu_nothing_is_written(monkeypatch, capsys):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(gpu_check, "PAGE", None)
    with pytest.raises(SystemExit) as end:
        gpu_check.main()
    assert end.value.code == 2
    assert "no CUDA device was found" in capsys.readouterr().err
