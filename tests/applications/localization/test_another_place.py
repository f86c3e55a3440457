"""Photos of other buildings in maps of real ones, without odometry."""

import csv

import numpy as np
import pytest
from PIL import Image

from sextant import Localizer
from sextant.localization.constants import RECOGNISED

#: of the images in each map, in the shape of its photos
SIZES = {"corridors": (160, 120), "gardens": (214, 120)}


def photos(folder, size, start=0, step=1, count=40):
    found = sorted(folder.glob("*.jpg"))[start::step][:count]
    return np.stack([np.asarray(Image.open(path).convert("RGB").resize(size)) for path in found])


def hallway(tower, size, video):
    with (tower / "labels.csv").open() as file:
        files = [row["file"] for row in csv.DictReader(file) if row["video"] == video]
    return np.stack([np.asarray(Image.open(tower / name).convert("RGB").resize(size)) for name in files[:20]])


@pytest.mark.slow
@pytest.mark.real_data
def test_in_the_wrong_building_all_is_lost_and_in_the_right_one_hardly_anything(real_data):
    corridors, gardens = real_data / "corridor_twice", real_data / "gardens_point"
    for home, size in SIZES.items():
        seen = {
            "corridors": photos(corridors / "query", size),
            "gardens": photos(gardens / "day_right", size, 1, 3, 20),
            "gardens by night": photos(gardens / "night_right", size, 1, 3, 20),
            "hallway": hallway(real_data / "ie_tower", size, "f08_hallway_main"),
            "castle": photos(real_data / "strecha_posed", size, 0, 1, 15),
        }
        folder, step, count = (
            ("corridor_twice/map", 1, 40) if home == "corridors" else ("gardens_point/day_left", 2, 60)
        )
        images = photos(real_data / folder, size, 0, step, count)
        line = np.column_stack([0.5 * np.arange(len(images)), np.zeros((len(images), 2))])
        localizer = Localizer.from_images(images, line, particles=300)
        for place, walked in seen.items():
            described, lost = [localizer.describe(image) for image in walked], []
            # by night 3.9 % are lost (200 seeds): of one seed's twenty, two are by chance every fifth time
            for seed in range(
                150 if (home, place) == ("gardens", "gardens by night") else 10 if place.startswith(home) else 1
            ):
                localizer.reset(seed)
                lost.append(np.mean([localizer.step(None, descriptor=row).lost for row in described]))
            lost = np.mean(lost)
            assert (localizer.recognised < RECOGNISED) != place.startswith(home), (home, place, localizer.recognised)
            if place.startswith(home):
                assert lost <= 0.05, (home, place)
            elif (home, place) != ("gardens", "corridors"):  # 28 of 40
                assert lost >= 0.9, (home, place)
            else:
                assert lost >= 0.6
