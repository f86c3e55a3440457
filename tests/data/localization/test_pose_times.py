"""Times in names by known forms, and numbers that are none: coordinates, counters, exposures, clocks without a date."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from sextant.chapters.localization.data.pose_times import no_times, poses_at, times_of_names

NOON = datetime(2023, 1, 1, 12, 0, 55, tzinfo=UTC).timestamp()


def times(*names):
    found = times_of_names([Path(name) for name in names])
    return None if found is None else found.tolist()


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("1305031102.175304.png", 1305031102.175304),
        ("1305031102.175304", 1305031102.175304),
        ("left-1403636579.763555584.png", 1403636579.763555584),
        ("1403636579.7635555841.png", 1403636579.763555584),
        ("1520531829_251950000.png", 1520531829.25195),
        ("frame_1520531829-251950.jpg", 1520531829.25195),
        ("1403636579763555584.png", 1403636579.763555584),
        ("cam1.0_1403636579763555584.png", 1403636579.763555584),
        ("cam0.1403636579763555584.png", 1403636579.763555584),
        ("1418381798086398.jpg", 1418381798.086398),
        ("1403636579763.jpg", 1403636579.763),
        ("1700000000.jpg", 1700000000),
        ("t1152907051.038_x0.2.jpeg", 1152907051.038),
        ("20230101_120055.png", NOON),
        ("20230101120055.png", NOON),
        ("IMG_20230101_120055.jpg", NOON),
        ("20230101_120055.500000.png", NOON + 0.5),
        ("PXL_20230101_120055123.MP.jpg", NOON + 0.123),
        ("VID_20230101_120055_123.jpg", NOON + 0.123),
        ("20230101120055123456.png", NOON + 0.123456),
        ("2023-01-01T12-00-55.5Z.png", NOON + 0.5),
        ("2023-01-01T12:00:55.123456+00:00.png", NOON + 0.123456),
        ("20230101T140055+0200.png", NOON),
        ("2023-01-01 12.00.55.png", NOON),
        ("2023_01_01_12_00_55.png", NOON),
        ("Screenshot 2023-01-01 at 12.00.55.png", NOON),
        ("DJI_20230101120055_0001_D.JPG", NOON),
        ("Photo 2023-01-01 12h00m55.jpg", NOON),
        ("0012.50.png", 12.5),
        ("99999.25.png", 99999.25),
    ],
)
def test_a_time_of_a_known_form_is_read_to_its_last_digit(name, seconds):
    assert times(name) == [seconds]


@pytest.mark.parametrize(
    "name",
    [
        "@548901.05@4179312.31@10@S@@@@@50@@@@0005@@.jpg",
        "548901.05_4179312.31.png",
        "548901.05.png",
        "120055.png",
        "120055.500000.png",
        "12-00-55.png",
        "000012.500000.png",
        "frame_000123.png",
        "20240102.png",
        "a.png",
        "v1.25.png",
        "1.5.png",
        "cam1.0_0001.png",
        "640x480_0.50.png",
        "55.7047_13.1910.jpg",
        "IMG-20230101-WA0001.jpg",
        "GX010001.MP4",
        "20230231_120055.png",
        "20231301_120055.png",
        "20230101_250055.png",
        "Screen Shot 2023-01-01 at 12.00.55 PM.png",
        "0000000012.png",
        "4179312310.png",
        "2403636579763555584.png",
        "14036365797635555840.png",
        "exp0.008.png",
        "f2.80_001.png",
        "192.168.0.12.png",
        "100000.00.png",
        "20230101_000012.png",
    ],
)
def test_other_numbers_are_no_times(name):
    assert times(name) is None
    assert name in no_times([name])


@pytest.mark.parametrize(
    "names",
    [
        ["20230101_120055.png", "1305031102.175304.png"],
        ["1305031102.175304.png", "a.png"],
        ["cam1.25_a.png", "cam1.25_b.png"],
        ["1305031102.5_a.png", "1305031102.5_b.png"],
        ["20230101_120055_1.png", "20230101_120055_2.png", "20230101_120056_1.png"],
        ["1403636579.5.png", "1403636579.763555584.png", "1403636579.9.png"],
        ["0.125.png", "0.250.png", "0.500.png", "1.000.png"],
        ["0.010.png", "0.012.png", "0.0166.png"],
        ["1.25.png", "1.5.png"],
        ["1403636579.1_1403636580.2.png", "1403636581.1_1403636582.2.png"],
        [f"20230101_{k:06d}.png" for k in range(30)],
    ],
    ids=[
        "two forms",
        "one without",
        "the same number",
        "the same time",
        "several in a second",
        "zeros left out",
        "exposures",
        "decimals differ",
        "decimals trimmed",
        "two times in each",
        "a counter after a date",
    ],
)
def test_a_folder_has_one_form_of_times_or_none(names):
    assert times(*names) is None
    assert no_times(names)


def test_the_time_that_differs_counts_and_neighbouring_nanoseconds_stay_in_order():
    assert times("1403636500.0_1403636579.1.png", "1403636500.0_1403636579.2.png") == [1403636579.1, 1403636579.2]
    stamps = [1403636579763555584 + 500 * k for k in range(5)]
    assert times(*(f"{stamp}.png" for stamp in stamps)) == [stamp / 10**9 for stamp in stamps]
    assert times("20230101_235959.5.png", "20230102_000000.5.png") == [NOON + 43144.5, NOON + 43145.5]


def test_an_empty_row_of_a_trajectory_leaves_the_rest_known():
    poses = np.array([[0, 0, 3.0], [1, 0, 3.1], [np.nan] * 3, [3, 0, -3.1], [4, 0, -3.0]])
    found = poses_at(np.arange(5.0), poses, np.array([0.5, 1.5, 3.5]), ["a", "b", "c"], 1.0, "test.run")
    assert found[[0, 2]] == pytest.approx(np.array([[0.5, 0, 3.05], [3.5, 0, -3.05]]))
    assert np.isnan(found[1]).all()
