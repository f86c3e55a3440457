import sys

import numpy as np
import pytest

from sextant.tasks import peak_memory
from sextant.tasks.peak_memory import peak_memory_mb, reset_peak_memory


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts anew")
def test_a_run_does_not_count_what_the_one_before_it_gave_back():
    reset_peak_memory()
    before = peak_memory_mb()
    large = np.ones(2**24)  # 128 MB
    assert before + 120 < peak_memory_mb() < before + 200
    del large
    assert peak_memory_mb() > before + 120
    reset_peak_memory()
    assert peak_memory_mb() < before + 64


def test_elsewhere_it_is_that_of_the_process(monkeypatch, tmp_path):
    monkeypatch.setattr(peak_memory, "_STATUS", tmp_path / "none")
    monkeypatch.setattr(peak_memory, "_RESET", tmp_path / "folder" / "none")
    reset_peak_memory()
    assert peak_memory_mb() > 50
