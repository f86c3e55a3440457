import numpy as np
import pytest

from sextant.chapters.localization.data.odometry_file import motions_of, read_odometry
from sextant.errors import UserError


@pytest.mark.parametrize(("line", "columns"), [("0.1,1,2,0", 4), ("1,2", 2), ("0.1,1,2,0,0,0,0,1", 8)])
def test_a_table_without_names_has_three_columns(tmp_path, line, columns):
    (path := tmp_path / "odometry.csv").write_text(f"{line}\n{line}\n")
    with pytest.raises(UserError, match=f"has {columns} columns and no header"):
        read_odometry(path)


def test_a_row_that_no_robot_can_have_come_to_is_named(tmp_path):
    (path := tmp_path / "odometry.csv").write_text("0,0,0\n1,0,0\n2e13,0,0\n")
    with pytest.raises(UserError, match=r"moves by 2e\+13, 0 from b\.png to c\.png"):
        motions_of(read_odometry(path), ["a.png", "b.png", "c.png"], None, path)


@pytest.mark.parametrize(("theta", "told"), [(90, True), (1.5, False)])
def test_headings_that_look_like_degrees_are_remarked(tmp_path, theta, told):
    (path := tmp_path / "odometry.csv").write_text(f"x,y,theta\n0,0,{theta}\n0,1,{theta}\n")
    motions, remarks = motions_of(read_odometry(path), ["a.png", "b.png"], None, path)
    assert np.isfinite(motions[1]).all()
    assert any("use heading_deg for degrees" in remark for remark in remarks) == told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "has no rows"),
        ("x,y\n0,0\n", "has the columns x, y"),
        ("x y theta\n0 0 0\n", "is neither a table with commas nor TUM; it begins with 'x y theta'"),
        ("1 0 0 0 0 0 0 7\n", "1 line cannot be used"),
    ],
)
def test_what_is_neither_a_table_nor_tum_is_told_with_what_would_be(tmp_path, text, told):
    (path := tmp_path / "odometry.csv").write_text(text)
    with pytest.raises(UserError, match=r"x,y,theta") as error:
        read_odometry(path)
    assert error.value.problem.startswith(f"odometry={path}")
    assert told in error.value.problem


# -- tables with times -------------------------------------------------------------------------------------------------

EPOCH = 1403636579


def motions(folder, text, times, encoding="utf-8"):
    """x of each motion (None where unknown) and the remarks, for images at some times."""
    (path := folder / "odometry.csv").write_text(text, encoding=encoding)
    wanted = None if times is None else np.array(times, np.float64)
    names = [f"{k}.png" for k in range(4 if times is None else len(times))]
    found, remarks = motions_of(read_odometry(path), names, wanted, path)
    return [None if motion is None else round(float(motion[0]), 6) for motion in found], " ".join(remarks)


def timed(column, stamps, separator=","):
    rows = [separator.join([str(stamp), str(2 * k), "0", "0"]) for k, stamp in enumerate(stamps)]
    return "\n".join([separator.join([column, "x", "y", "theta"]), *rows])


@pytest.mark.parametrize(
    ("column", "unit"),
    [("t", 1), ("time", 1), ("Timestamp", 1), ("stamp", 1), ("sec", 1), ("time_s", 1), ("secs", 1), ("time_ms", 1e3),
     ("timestamp_us", 1e6), ("time (ms)", 1e3), ("timestamp [ns]", 1e9), ("#timestamp [ns]", 1e9), ("time_ns", 1e9)],
)  # fmt: skip
def test_a_column_of_times_is_read_in_its_unit(tmp_path, column, unit):
    text = timed(column, [f"{k * unit:.0f}" for k in range(5)])
    assert motions(tmp_path, text, [0.5, 1.5, 3.5]) == (
        [None, 2.0, 4.0], "odometry: poses are interpolated at the times of the images",
    )  # fmt: skip


@pytest.mark.parametrize("digits", [0, 3, 6, 9])
def test_times_since_1970_are_in_the_unit_that_their_digits_show(tmp_path, digits):
    text = timed("timestamp", [(EPOCH + k) * 10**digits for k in range(5)])
    assert motions(tmp_path, text, [EPOCH + 0.5, EPOCH + 1.5])[0] == [None, 2.0]


def test_seconds_and_nanoseconds_in_two_columns(tmp_path):
    rows = "\n".join(f"{EPOCH + k},{500_000_000 * (k % 2)},{k},0,0" for k in range(5))
    assert motions(tmp_path, f"sec,nsec,x,y,theta\n{rows}", [EPOCH, EPOCH + 1.5])[0] == [None, 1.0]
    whole = "\n".join(f"{EPOCH + k + k % 2 / 2},{row}" for k, row in enumerate(rows.splitlines()))
    assert motions(tmp_path, f"time,sec,nsec,x,y,theta\n{whole}", [EPOCH, EPOCH + 1.5])[0] == [None, 1.0]


@pytest.mark.parametrize(
    ("stamps", "times", "expected", "said"),
    [
        ([2, 0, 1, 3], [0, 1], [None, 2.0], "have been sorted"),  # x is 2 and 4 at 0 and 1 s
        ([10, 10.5, 11], [10, 10.5, 11], [None, 2.0, 2.0], "at the times"),
        ([10, 10.5, 11], [10, 10.25, 10.5, 10.75, 11], [None, 1.0, 1.0, 1.0, 1.0], "at the times"),
        ([0, 1, 2], [100, 101, 102], [None, 2.0, 2.0], "its clock is -100.000 s off the images"),
        ([0, 1, 2, 3], None, [None, 2.0, 2.0, 2.0], "its times are not used, since images have none"),
        ([0, 1, 2, 60], [0, 1, 30, 60], [None, 2.0, None, None], "gaps of more than 5 s"),
    ],
    ids=["unsorted", "equal", "between", "another clock", "images without", "a gap"],
)
def test_rows_go_by_time_where_clocks_are_one(tmp_path, stamps, times, expected, said):
    found, remarks = motions(tmp_path, timed("time", stamps), times)
    assert found == expected
    assert said in remarks


@pytest.mark.parametrize(
    ("text", "times", "said"),
    [
        (timed("time", [0, 500, 1000, 1500]), [0, 0.5, 1, 1.5, 1.6], r"few at a time with a pose\n.*column time_ms"),
        (timed("time", [0, 1, 2]), [100, 101, 103, 107], r"from 0.000 s to 2.000 s; the images .* none at a time"),
        (timed("time", [0, 1, 1, 2]), [0, 1, 2], r"lines 3 and 4 have different poses at the same time, time=1"),
        (timed("time", [0, "one", 2]), [0, 1, 2], r"line 3: time='one' is not a time"),
        ("time,nsec,x,y,theta\n0.5,500000000,0,0,0\n", [0], r"line 2: time=0.5 has a fraction of a second, and nsec=5"),
        (timed("time", [0, "nan", 2]), [0, 1, 2], r"line 3: time='nan' is not a time"),
        (timed("time", [0, 1, 2]), None, r"3 rows for 4 images, .*; its times cannot be used: 4 of 4 names contain no"),
        ("x,y,theta\n0,0,0\n1,two,0\n", [0, 1], r"line 3 is not a pose: 1,two,0"),
        ("x,y,theta\n0,0,0\n1,5,0,0\n", [0, 1], r"line 3: 4 values for 3 columns: decimal commas\?"),
        ("x,y,theta,theta\n0,0,0,9\n", [0], r"odometry=.* has 2 columns named theta"),
        ("t,x,y,theta,t\n0,0,0,0,9\n", [0], r"odometry=.* has 2 columns named t"),
        ("x,y,theta,heading_deg\n0,0,0,90\n", [0], r"has both theta and heading_deg"),
        ("x;y;theta\n0,5;0;0\n0.5;0;0\n", [0, 1], r"has decimal commas and decimal points"),
    ],
)
def test_times_and_numbers_that_cannot_be_right_are_one_message(tmp_path, text, times, said):
    with pytest.raises(UserError, match=said):
        motions(tmp_path, text, times)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_tables_of_every_separator_and_encoding(tmp_path, separator, encoding):
    text = "\r\n".join(["# of a robot", "", timed("time", range(4), separator)]) + separator
    assert motions(tmp_path, text, [0, 1, 3], encoding)[0] == [None, 2.0, 4.0]


@pytest.mark.parametrize("separator", [" ", "\t", "  "])
def test_tum_of_every_blank_with_a_mark_and_comments(tmp_path, separator):
    rows = [separator.join(["0", "0", "0", "0", "0", "0", "0", "1"]).replace("0", str(k), 2) for k in range(3)]
    (path := tmp_path / "o.txt").write_text("\ufeff# a comment\n\n" + "\r\n".join(rows), encoding="utf-8")
    assert read_odometry(path).poses[:, 0].tolist() == [0, 1, 2]


def test_an_unknown_row_leaves_the_headings_after_it(tmp_path):
    text = "time,x,y,theta\n0,0,0,0\n1,1,0,0\n2,,,\n3,3,0,0\n4,4,0,0.1\n"
    assert motions(tmp_path, text, [0, 1, 2, 3, 4])[0] == [None, 1.0, None, None, 1.0]
