"""Peaks of responses, clustered by complete linkage."""

import pytest
import torch

from sextant.errors import ArgumentError, UserError
from sextant.layers.cosfire import Keypoint, keypoints


def response(*peaks, size=(40, 50)):
    found = torch.zeros(size)
    for x, y, score in peaks:
        found[y, x] = score
    return found


def test_peaks_come_the_strongest_first():
    peaks = [(5, 6, 0.5), (40, 30, 0.75), (20, 3, 0.25)]
    assert keypoints(response(*peaks)) == [Keypoint(*peaks[i]) for i in (1, 0, 2)]


def test_near_peaks_are_one_and_the_strongest_speaks_for_them():
    peaks = [(5, 6, 0.5), (9, 6, 1.0), (13, 6, 0.75)]
    assert keypoints(response(*peaks), min_distance=8.5) == [Keypoint(9, 6, 1.0)]
    assert keypoints(response(*peaks), min_distance=5.0)[0] == Keypoint(9, 6, 1.0)
    assert len(keypoints(response(*peaks), min_distance=5.0)) == 2
    assert len(keypoints(response(*peaks), min_distance=3.0)) == 3


def test_what_is_below_the_threshold_is_no_peak():
    found = response((5, 6, 0.5), (30, 30, 1.0))
    assert keypoints(found, threshold=1.0) == [Keypoint(30, 30, 1.0)]
    assert len(keypoints(found, threshold=0.5)) == 2
    assert keypoints(found, threshold=1.001) == []
    assert keypoints(torch.zeros(9, 9)) == []


def test_a_level_response_has_no_peaks_but_those_that_stand_out():
    level = torch.full((400, 500), 0.25)
    assert keypoints(level) == []
    level[100, 200] = 0.5
    assert keypoints(level) == [Keypoint(200, 100, 0.5)]


def test_of_very_many_peaks_the_strongest_are_looked_at():
    noise = torch.rand(300, 300, generator=torch.Generator().manual_seed(0))
    found = keypoints(noise, min_distance=0.0, most=50)
    assert len(found) == 50
    assert found[0].score == noise.max()


def test_gradients_do_not_matter():
    assert keypoints(response((5, 6, 0.5)).requires_grad_()) == [Keypoint(5, 6, 0.5)]


@pytest.mark.parametrize("options", [{"threshold": float("nan")}, {"min_distance": float("nan")}, {}])
def test_nan_is_no_absence_of_keypoints(options):
    found = response((5, 6, 0.5)) if options else response((5, 6, float("nan")))
    with pytest.raises(ArgumentError, match=r"nan"):
        keypoints(found, **options)


def test_bytes_are_refused():
    with pytest.raises(UserError, match=r"floating-point response, got torch\.uint8"):
        keypoints(response((5, 6, 200)).byte())
