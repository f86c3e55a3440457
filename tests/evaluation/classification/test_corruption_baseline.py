import numpy as np
import pytest

from sextant.errors import UserError
from sextant.evaluation.corruption_errors import (
    ALEXNET_CIFAR10_C,
    ALEXNET_IMAGENET_C,
    ALL_19,
    BENCHMARK_15,
    EXAMPLE,
    CorruptionBaseline,
    read_baseline,
    write_baseline,
)


def test_the_published_baselines_have_their_printed_means():
    assert tuple(ALEXNET_CIFAR10_C.errors) == ALL_19
    assert np.mean([*ALEXNET_CIFAR10_C.errors.values()]) == pytest.approx(0.2908, abs=2e-4)
    assert tuple(ALEXNET_IMAGENET_C.errors) == BENCHMARK_15


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "folder" / "alexnet.json"
    write_baseline(path, ALEXNET_CIFAR10_C)
    assert read_baseline(path) == ALEXNET_CIFAR10_C


def test_the_example_that_errors_show_can_be_read(tmp_path):
    (tmp_path / "b.json").write_text(EXAMPLE)
    assert read_baseline(tmp_path / "b.json").errors["fog"] == (0.2, 0.25, 0.3, 0.35, 0.5)


def test_a_mean_alone_and_missing_names_will_do(tmp_path):
    (tmp_path / "mine.json").write_text('{"clean": 0.1, "errors": {"fog": 0.3}}')
    assert read_baseline(tmp_path / "mine.json") == CorruptionBaseline("mine", "mine.json", 0.1, {"fog": (0.3,)})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[1]", "has no errors by corruption"),
        ('{"clean": 0.1}', "has no errors by corruption"),
        ('{"clean": 0.1, "errors": {}}', "has no errors by corruption"),
        ('{"errors": {"fog": 0.1}}', "clean in the baseline .* is null"),
        ('{"clean": [0.1], "errors": {"fog": 0.1}}', r"clean in the baseline .* is \[0.1\]"),
        ('{"clean": 0.1, "errors": {"fog": 30}}', r"errors.fog in the baseline .* is 30, .*Divide percentages by 100"),
        ('{"clean": 0.1, "errors": {"fog": [0.1, "x"]}}', "errors.fog in the baseline"),
        ('{"clean": 0.1, "errors": {"fog": []}}', "errors.fog in the baseline"),
        ('{"clean": 0.1, "errors": {"fog": NaN}}', "errors.fog in the baseline"),
        ('{"clean": true, "errors": {"fog": 0.1}}', "clean in the baseline"),
    ],
)
def test_a_file_that_is_no_baseline_is_refused(tmp_path, content, message):
    (tmp_path / "b.json").write_text(content)
    with pytest.raises(UserError, match=f"(?s){message}"):
        read_baseline(tmp_path / "b.json")


def test_a_file_that_is_missing_or_no_text_is_refused(tmp_path):
    with pytest.raises(UserError, match="cannot be read: No such file"):
        read_baseline(tmp_path / "b.json")
    (tmp_path / "b.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(UserError, match="is not JSON"):
        read_baseline(tmp_path / "b.json")
