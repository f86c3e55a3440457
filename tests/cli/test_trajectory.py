import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from sextant.chapters.localization.data.pose_formats import write_tum
from sextant.cli import run


@pytest.fixture
def files(tmp_path):
    times = np.arange(200) / 10
    poses = np.column_stack([20 * np.cos(times), 20 * np.sin(times), times])
    write_tum(tmp_path / "reference.tum", times, poses)
    write_tum(tmp_path / "estimate.tum", times, poses + np.array([0.3, -0.4, 0.01]))
    return [str(tmp_path / "reference.tum"), str(tmp_path / "estimate.tum")]


def test_errors_picture_and_numbers(files, tmp_path, capsys):
    picture, numbers = tmp_path / "plan.png", tmp_path / "errors.json"
    run("trajectory", [*files, f"figure={picture}", "alignment=rigid", f"json={numbers}"])
    said = capsys.readouterr().out
    assert "200 frames in both, of 200 and 200" in said
    assert "APE, alignment none" in said
    assert "KITTI: t_rel" in said
    found = json.loads(numbers.read_text())
    assert found["absolute_m"]["none"]["rmse"] == pytest.approx(0.5)
    assert found["absolute_m"]["rigid"]["rmse"] == pytest.approx(0, abs=1e-9)
    with Image.open(picture) as drawn:
        assert drawn.width > 800


def test_that_most_poses_have_no_partner_is_said(files, capsys):
    estimate = Path(files[1])
    lines = estimate.read_text().splitlines()
    moved = [f"{float(line.split()[0]) + 0.05:.3f} {line.split(' ', 1)[1]}" for line in lines if line[0] != "#"]
    estimate.write_text("\n".join(lines[:11] + moved[20:]))
    run("trajectory", files)
    said = " ".join(capsys.readouterr().out.split())
    assert "have no counterpart in the other and are excluded from these errors" in said
    assert "max_gap_s=0.01" in said
    run("trajectory", [*files, "max_gap_s=0.06"])
    assert "no counterpart" not in capsys.readouterr().out


@pytest.mark.parametrize("form", ["tum", "table"])
def test_a_trajectory_equals_itself(files, tmp_path, capsys, form):
    if form == "table":
        (tmp_path / "poses.csv").write_text("file,x,y,heading\na.png,0,0,0\nb.png,1,0,90\n")
    given = files[0] if form == "tum" else str(tmp_path / "poses.csv")
    numbers = tmp_path / "errors.json"
    run("trajectory", [given, given, f"json={numbers}"])
    assert json.loads(numbers.read_text())["absolute_m"]["none"]["max"] == 0


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "trajectory needs two files, got 0"),
        (["alignment=best"], "alignment=best must be one of none, rigid, similarity"),
        (["max_gap=1"], "max_gap=1: unknown key"),
        (["<files>", "figure=plan.txt"], "figure=plan.txt must be a file of its own that ends in .png, .svg, .pdf"),
        (["<files>", "alignment=rigid"], "alignment=rigid applies to the picture, but figure= is missing"),
        (["<files>", "json=<folder>"], "json=<folder> must be a file of its own that ends in .json"),
        (["<files>", "json=<folder>/estimate.tum"], "must be a file of its own that ends in .json"),
        (["<files>", "json=<folder>/estimate.tum/a.json"], "json=<folder>/estimate.tum/a.json cannot be written: "),
        (["<files>", "figure=<folder>/estimate.tum/a.png"], "figure=<folder>/estimate.tum/a.png cannot be written: "),
    ],
)
def test_mistakes_are_one_message(arguments, said, files, tmp_path, capsys):
    given = [word.replace("<folder>", str(tmp_path)) for word in arguments]
    given = [*files, *given[1:]] if given[:1] == ["<files>"] else given
    with pytest.raises(SystemExit) as ended:
        run("trajectory", given)
    assert ended.value.code == 2
    assert said.replace("<folder>", str(tmp_path)) in capsys.readouterr().err.replace("\n", "")
