import pytest

from benchmarks.__main__ import main


def test_a_benchmark_that_there_is_not_is_named_before_any_runs():
    with pytest.raises(SystemExit, match=r"benchmarks --help: must be one of start_up, .*; all if none is named$"):
        main(["crops", "--help"])
