"""What a finished run and calibrated photos look like in a terminal.

Boundaries: few and many metrics, with a table and without; tables of few and many columns, long names of drives; photos
with and without reasons, intervals, a focal length by EXIF that was used, would help or would not; long names of files.
"""

import re
from pathlib import Path

import pytest

from sextant.atomic_files import write_json
from sextant.chapters.calibration.predict import tell
from sextant.chapters.calibration.written_cameras import WrittenCameras
from sextant.cli.show import show_next, show_result, show_start
from sextant.composing.compose import compose, to_plain
from sextant.console.console import console
from sextant.lifecycle.checks import checked
from sextant.lifecycle.execute import Outcome
from sextant.runs.directory import RunDirectory

DRIVE = {
    "drive": "summer_noon", "runs": "20", "converged %": "100", "95 %": "84-100", "frames": "12", "p90": "30",
    "tracking %": "99.3", "error": "0.12", "deg": "1.3", "in region %": "94", "NLL": "-1.25", "recovered %": "100",
    "in frames": "17", "ms/step/run": "12.34",
}  # fmt: skip


@pytest.fixture(autouse=True)
def narrow(monkeypatch):
    monkeypatch.setattr(console, "_width", 100)


def shown_run(tmp_path, capsys, metrics, table):
    directory = RunDirectory(tmp_path / "runs" / "localization" / "1a2b3c4d-s0")
    directory.path.mkdir(parents=True)
    found = {f"test/{k}/success": 0.5 for k in range(metrics)}
    results = {"metrics": found, "outcome": "finished", "parameters": 3, "timing": {"fit_s": 1.0, "test_s": 2.0}}
    write_json(directory.metrics, results | ({"table": table} if table else {}))
    show_result(Outcome("finished", directory.path))
    return capsys.readouterr().out


@pytest.mark.parametrize("drive", ["summer_noon", "moved, kidnapped twice", "a drive through the corridors by night"])
@pytest.mark.parametrize("columns", [5, 11, 12, 14])
def test_a_run_with_many_metrics_ends_with_its_table(tmp_path, capsys, drive, columns):
    row = dict(list(DRIVE.items())[:columns]) | {"drive": drive}
    said = shown_run(tmp_path, capsys, 70, [row, row])
    lines = said.splitlines()
    table = lines[1 : next(i for i, line in enumerate(lines) if "70 in " in line)]
    assert "On the test split" in lines[0]
    assert all(len(line) <= 100 for line in table)
    assert "test/3/success" not in said
    assert "…" not in said
    assert lines[-1].startswith("figures    /")
    words = set(re.split(r"[ │┃]+|(?<=/)", " ".join(table)))
    assert words.issuperset(re.split(r" |(?<=/)", " ".join([*row, *list(row.values())[1:]])))
    ends = next(line.index("runs") for line in table if "runs" in line)  # of the first column
    assert drive.replace(" ", "") * 2 == "".join(re.findall(r"[\w,]+", " ".join(line[:ends] for line in table)))[5:]


@pytest.mark.parametrize("metrics", [1, 20, 21])
@pytest.mark.parametrize("table", [None, [DRIVE]])
def test_few_metrics_are_shown(tmp_path, capsys, metrics, table):
    said = shown_run(tmp_path, capsys, metrics, table)
    assert ("test/0/success" in said) is (metrics <= 20 or table is None)


@pytest.mark.parametrize(
    ("task", "epoch"),
    [
        ("classification", "2 epochs of batches of 8, "),
        ("calibration", "2 epochs of batches of 8, "),
        ("cosfire", "2 epochs of batches of 8, "),
        ("place_recognition", "2 epochs of batches of 5 places under 3 conditions, "),
        ("localization", "2 epochs, "),
    ],
)
def test_a_run_shows_of_what_its_epochs_consist(tmp_path, capsys, task, epoch):
    sizes = ["task.batch_places=5", "task.batch_conditions=3"] if task == "place_recognition" else []
    config = checked(to_plain(compose([f"task={task}", *sizes, "trainer.max_epochs=2", "trainer.batch_size=8"])))
    show_start(config, RunDirectory(tmp_path / "runs" / task / "1a2b3c4d-s0"), ())
    assert f"training {epoch}" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(("trained", "tested"), [(None, None), (0.0, 2.0), (1.5, 2.0)])
def test_what_follows_a_run_is_of_one_that_was_trained(tmp_path, capsys, trained, tested):
    """Boundaries: a run that a nan stopped, which has no times; one that was only evaluated; one that was trained."""
    directory = RunDirectory(tmp_path / "runs" / "classification" / "1a2b3c4d-s0")
    directory.path.mkdir(parents=True)
    metrics, outcome = ({"test/x": 0.5}, "finished") if tested else ({}, "diverged")
    timing = {"fit_s": trained, "test_s": tested}
    write_json(directory.metrics, {"metrics": metrics, "outcome": outcome, "parameters": 3, "timing": timing})
    found = Outcome(outcome, directory.path)
    show_result(found)
    assert ("trained in 1.5 s" in capsys.readouterr().out) is bool(trained)
    show_next(checked(to_plain(compose([]))), found, [])
    assert ("sextant evaluate" in capsys.readouterr().out) is bool(trained)


def row(file="a.jpg", focal=1000.0, ends=(900.0, 1100.0), exif=None, reasons=(), by="conformal"):
    return {
        "file": f"photos/{file}", "tilt_deg": 1.0, "roll_deg": -0.5, "focal_px": focal, "vfov_deg": 40.0, "k1": 0.01,
        "confidence": {"verdict": "weak" if reasons else "good", "reasons": list(reasons)},
        "intervals": {"95": {"focal_px": list(ends)}}, "intervals_by": by, "exif_focal_px": exif,
    }  # fmt: skip


HINT = "EXIF gives 1,035 px; to use it: focal_prior=exif"
WIDE, FEW, NAN = "field of view: 68 % interval ±3.9°, wider than ±3.6°", "few lines constrain the lens", float("nan")
LONG = "a photo with a rather long name of a street in the old town, 2026-11-28 at noon [draft].jpg"
PHOTOS = {
    "good, without EXIF": (row(), None),
    "one reason": (row(reasons=[WIDE]), WIDE),
    "two reasons": (row(reasons=[WIDE, FEW]), f"{WIDE}; {FEW}"),
    "EXIF would help": (row(exif=1035.4), HINT),
    "EXIF would help at one end": (row(exif=1035.4, ends=(1030.0, 1200.0)), HINT),
    "EXIF beside the interval": (row(exif=1035.4, ends=(500.0, 700.0)), HINT),
    "EXIF would not help": (row(exif=1035.4, ends=(1000.0, 1080.0)), None),
    "EXIF was used": (row(exif=1035.4, by="focal_prior=exif"), None),
    "reasons and EXIF": (row(exif=1035.4, reasons=[WIDE]), f"{WIDE}; {HINT}"),
    "no interval": (row(ends=(NAN, NAN)), None),
    "a long name": (row(LONG, reasons=[WIDE, FEW], exif=1035.4), f"{WIDE}; {FEW}; {HINT}"),
    "a name like markup": (row("[bold]x.jpg", reasons=[WIDE]), WIDE),
}


@pytest.mark.parametrize("name", PHOTOS)
def test_a_photo_has_a_row_with_its_interval_and_one_line_of_reasons(name, capsys):
    photo, reasons = PHOTOS[name]
    file = photo["file"].removeprefix("photos/")
    tell(WrittenCameras([photo, row("other.jpg")], None, [Path("calibrations.csv")]), {})
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith(f"{file}: ")] == ([f"{file}: {reasons}"] if reasons else [])
    assert all(len(line) <= 100 for line in lines if set(line) & set("│┃━┏"))
    table = "".join(line for line in lines if line.startswith("│"))
    low, high = photo["intervals"]["95"]["focal_px"]
    assert (f"1000 [{low:.0f}, {high:.0f}]" if low == low else "1000 │") in table
    assert "nan" not in table
    assert lines[-2:] == ["2 photos calibrated", "calibrations.csv"]
    assert not [line for line in lines if line.startswith("other.jpg")]
