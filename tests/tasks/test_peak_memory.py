import json
import subprocess
import sys

import pytest

from sextant.training import peak_memory
from sextant.training.peak_memory import peak_memory_mb, reset_peak_memory

# In a process of its own: that of the suite may give back gigabytes at any moment.
COUNT = """
import json
from sextant.training.peak_memory import peak_memory_mb, reset_peak_memory
reset_peak_memory()
peaks = [peak_memory_mb()]
large = b"1" * 2**27
peaks.append(peak_memory_mb())
del large
peaks.append(peak_memory_mb())
reset_peak_memory()
peaks.append(peak_memory_mb())
print(json.dumps(peaks))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux counts anew")
def test_a_run_does_not_count_what_the_one_before_it_gave_back():
    before, held, given_back, anew = json.loads(subprocess.check_output([sys.executable, "-c", COUNT]))
    assert before + 120 < held < before + 200
    assert given_back > before + 120
    assert anew < before + 64


def test_elsewhere_it_is_that_of_the_process(monkeypatch, tmp_path):
    monkeypatch.setattr(peak_memory, "_STATUS", tmp_path / "none")
    monkeypatch.setattr(peak_memory, "_RESET", tmp_path / "folder" / "none")
    reset_peak_memory()
    assert peak_memory_mb() > 50
