import numpy as np
import pytest

from sextant.data.localization.odometry_file import motions_of, read_odometry
from sextant.errors import UserError


@pytest.mark.parametrize(("line", "columns"), [("0.1,1,2,0", 4), ("1,2", 2), ("0.1,1,2,0,0,0,0,1", 8)])
def test_a_table_without_names_has_three_columns(tmp_path, line, columns):
    (path := tmp_path / "odometry.csv").write_text(f"{line}\n{line}\n")
    with pytest.raises(UserError, match=f"has {columns} columns and no line that names them"):
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
    assert any("a column heading_deg holds degrees" in remark for remark in remarks) == told


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "has no rows"),
        ("x;y;theta\n0;0;0\n", "is neither a table with commas nor TUM; it begins with 'x;y;theta'"),
        ("x y theta\n0 0 0\n", "is neither a table with commas nor TUM; it begins with 'x y theta'"),
        ("1 0 0 0 0 0 0 7\n", "1 lines cannot be used"),
    ],
)
def test_what_is_neither_a_table_nor_tum_is_told_with_what_would_be(tmp_path, text, told):
    (path := tmp_path / "odometry.csv").write_text(text)
    with pytest.raises(UserError, match=r"x,y,theta") as error:
        read_odometry(path)
    assert error.value.problem.startswith(f"odometry={path}")
    assert told in error.value.problem
