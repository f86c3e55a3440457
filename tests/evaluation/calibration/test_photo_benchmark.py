import math

import numpy as np
import pytest

from sextant.chapters.calibration.metrics.photo_benchmark import (
    PUBLISHED,
    Answers,
    Truth,
    blame_table,
    error_table,
    interval_table,
    verdict_table,
    worst_table,
)

#: tilt, roll, focal length and k1 of six photos of three clusters; of the last neither pose nor distortion is known
CAMERAS = np.array([[0.1, 0.0, 1.0, 0.0]] * 5 + [[math.nan, math.nan, 1.0, math.nan]])
TRUTH = Truth(CAMERAS, np.full(6, 4 / 3), ["a", "a", "b", "b", "c", "c"])


def answers(tilt_off_deg, focal_ratio, half_deg=2.0, verdict="good"):
    cameras = np.nan_to_num(CAMERAS)
    cameras[:, 0] += np.radians(tilt_off_deg)
    cameras[:, 2] *= focal_ratio
    half = {level: np.full((6, 3), np.radians(half_deg * scale)) for level, scale in (("68", 1), ("95", 2))}
    return Answers(cameras, half, [verdict] * 6)


def cell(table, method, title):
    titles, rows = table
    return next(row for row in rows if row[0] == method)[titles.index(title)]


def test_medians_and_areas_are_of_the_photos_whose_truth_is_known():
    table = error_table(TRUTH, {"exact": answers(0.0, 1.0), "off": answers([0, 0, 3, 3, 6, 99], 1.1)})
    assert cell(table, "exact", "tilt (°)") == "0.00 [0.00, 0.00]"
    assert cell(table, "off", "tilt (°)").startswith("3.00 [")
    assert cell(table, "off", "focal (%)").startswith("10.0 [")
    titles, rows = table
    areas = rows[1][titles.index("tilt (°)") + 1]
    assert areas.split(" / ")[0] == "40.0"  # two of five within a degree
    assert {row[0] for row in rows[2:]} == {f"*{name}*" for name, *_ in PUBLISHED}
    assert all(len(row) == len(titles) for row in rows)


def test_what_no_photo_knows_is_a_dash():
    truth = Truth(CAMERAS[5:], np.array([4 / 3]), ["c"])
    table = error_table(truth, {"one": Answers(answers(0, 1).cameras[5:], {}, ["good"])})
    assert cell(table, "one", "tilt (°)") == cell(table, "one", "rays (°)") == "–"
    assert cell(table, "one", "focal (%)") == "0.0"


def test_a_failed_photo_is_an_infinite_error():
    said = answers(0.0, 1.0)
    said.cameras[:3] = math.nan
    assert cell(error_table(TRUTH, {"x": said}), "x", "tilt (°)").startswith("inf")


def test_intervals_hold_the_truth_as_often_as_counted():
    table = interval_table(TRUTH, {"x": answers([1, 1, 3, 3, 6, 0], 1.0)})
    assert cell(table, "x", "tilt, 68 %").startswith("40 [")
    assert cell(table, "x", "tilt, 95 %").startswith("80 [")
    assert cell(table, "x", "vfov, 68 %").startswith("100 [")


def test_an_interval_of_roll_reaches_across_half_a_turn():
    upside_down, said = CAMERAS.copy(), answers(0, 1)
    upside_down[:, 1], said.cameras[:, 1] = math.pi - 0.01, -math.pi + 0.01
    assert cell(
        interval_table(Truth(upside_down, TRUTH.aspect, TRUTH.clusters), {"x": said}), "x", "roll, 68 %"
    ).startswith("100")


def test_errors_by_verdict():
    said = answers([1, 1, 1, 5, 5, 5], [1, 1, 1, 1.3, 1.3, 1.3])
    said = Answers(said.cameras, said.half, ["good"] * 3 + ["weak"] * 2 + ["failed"])
    titles, rows = verdict_table(TRUTH, said)
    by_verdict = {row[0]: dict(zip(titles, row, strict=True)) for row in rows}
    assert by_verdict["good"]["photos"] == "3"
    assert by_verdict["good"]["tilt (°)"] == "1.00"
    assert by_verdict["weak"]["focal off by over 20 %"] == "2"
    assert by_verdict["not trustworthy"]["tilt (°)"] == "–"
    assert float(by_verdict["weak"]["focal (%)"]) == pytest.approx(30)


def test_a_table_of_no_method_is_refused():
    with pytest.raises(ValueError, match="methods is empty"):
        interval_table(TRUTH, {})


def test_a_wrong_joint_camera_is_put_on_the_part_that_is_wrong_alone_and_a_failure_is_the_worst():
    """Of five photos the joint is right on one; network, lines, both and neither are wrong on the others."""
    truth = Truth(np.tile([0.0, 0.0, 1.0, np.nan], (5, 1)), np.full(5, 1.5), list("abcde"))

    def said_by(wrong, failed=()):
        focals = np.where(np.isin(np.arange(5), wrong), 1.5, 1.0)
        cameras = np.column_stack([np.zeros(5), np.zeros(5), focals, np.zeros(5)])
        cameras[list(failed)] = np.nan
        return Answers(cameras, {}, ["weak"] * 5)

    said = {"network": said_by([1, 3]), "lines": said_by([2], failed=[3]), "joint": said_by([1, 2, 3], failed=[4])}
    tilt, roll, focal = blame_table(truth, said)[1]
    assert focal == ["focal (%) > 20", "5", "4", "1", "1", "1", "1"]
    assert tilt[1:] == roll[1:] == ["5", "1", "0", "0", "0", "1"]  # the joint failed on the last
    rows = worst_table(truth, list("abcde"), said, count=4)[1]
    assert [row[0] for row in rows] == ["e", "b", "c", "d"]
    assert rows[0][-1] == "–"
