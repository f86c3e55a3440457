"""What ``make gpu-check`` writes, and what it says without a GPU."""

import pytest
import torch

from benchmarks import gpu_check

REPORT = """<testsuites><testsuite>
<testcase classname="tests.a" name="test_one" time="1.5"/>
<testcase classname="tests.a" name="test_two" time="0.1"><failure message="no"/></testcase>
<testcase classname="tests.b" name="test_three" time="0.0"><skipped/></testcase>
</testsuite></testsuites>"""


def test_the_page_has_every_test_and_every_timing():
    tests = gpu_check.read_report(REPORT)
    assert [outcome for _, outcome, _ in tests] == ["passed", "failed", "skipped"]
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
