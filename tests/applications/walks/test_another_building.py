"""A walk through the corridors of a map, and walks through other places."""

import csv

import numpy as np
import pytest

from sextant import PhotoCalibrator
from sextant.tools.walks.walking import localize_walk


@pytest.mark.slow
@pytest.mark.real_data
def test_a_walk_is_localized_in_its_building_and_lost_in_others(real_data, tmp_path):
    corridors = real_data / "corridor_twice"
    with (real_data / "ie_tower" / "labels.csv").open() as file:
        hallway = [row["file"] for row in csv.DictReader(file) if row["video"] == "f08_hallway_main"][:20]
    walks = {
        "corridors": sorted((corridors / "query").glob("*.jpg")),
        "gardens": sorted((real_data / "gardens_point" / "day_right").glob("*.jpg"))[1::10],
        "hallway": [real_data / "ie_tower" / name for name in hallway],
    }
    for name, files in {"map": sorted((corridors / "map").glob("*.jpg")), **walks}.items():
        (tmp_path / name).mkdir()
        for number, file in enumerate(files):
            (tmp_path / name / f"{number:03d}.jpg").symlink_to(file)
    rows = [f"{number:03d}.jpg,{number / 2},0,0" for number in range(40)]
    (tmp_path / "map" / "poses.csv").write_text("\n".join(["file,x,y,heading", *rows]))
    calibrator, mapped, localized = PhotoCalibrator.load(), tmp_path / "map", {}
    for name, files in walks.items():
        out = tmp_path / f"found in {name}"
        walk = localize_walk(tmp_path / name, mapped, out, calibrator=calibrator, photos=4, replay="none")
        mapped = tmp_path / "found in corridors" / "map"  # once made, it serves for the others
        localized[name] = np.array([not row.told.lost for row in walk.rows])
        if name == "corridors":
            with (corridors / "ground_truth.csv").open() as file:
                true = {row["query"]: np.array(row["map_matches"].split(), int) for row in csv.DictReader(file)}
            matches = [true[f"query/{file.name}"] for file in files]
            away = [abs(row.told.pose[0] - (at - 1) / 2).min() for row, at in zip(walk.rows, matches, strict=True)]
    assert localized["corridors"].mean() > 0.85
    assert np.mean(np.array(away)[localized["corridors"]] < 1) > 0.85
    assert localized["gardens"].mean() < 0.1
    assert localized["hallway"].mean() < 0.1
