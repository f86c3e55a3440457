"""What a test says: figures without frames that cannot be told apart, the ceiling, all pairs, and factors."""

from dataclasses import replace

import numpy as np
import pytest

from sextant.chapters.places import report
from sextant.chapters.places.data import ImageRows, PlaceImages, PlaceTolerance
from sextant.chapters.places.invariance import (
    condition_pairs,
    factor_of,
    has_factors,
    invariance,
    invariance_facts,
    invariance_figure,
    invariance_metrics,
    invariance_table,
    pair_arrays,
    pair_metrics,
)
from sextant.figures.style import save_figure

TOLERANCE = PlaceTolerance("frames", 1, 5)


def ride(conditions, frames, same=(), flat=()):
    """Noise pictures; frames of ``same`` show the one before them, those of ``flat`` show nothing."""
    pictures = []
    for number in range(len(conditions)):
        rng = np.random.default_rng(number)
        for k in range(frames):
            picture = rng.integers(0, 256, (8, 12, 3))
            pictures.append(np.full((8, 12, 3), 50) if k in flat else pictures[-1] if k in same else picture)
    images = ImageRows(np.array(pictures, np.uint8))
    traverse = np.repeat(np.arange(len(conditions)), frames)
    names = tuple(str(k) for k in range(len(pictures)))
    return PlaceImages(images, traverse, tuple(conditions), np.tile(np.arange(frames), len(conditions)), names)


def by_frame(places, wrong=()):
    """Descriptors that find the right frame, but for queries of the frames in ``wrong``, which find another place."""
    shown = places.frame.copy()
    shown[(places.traverse > 0) & np.isin(places.frame, wrong)] = 0
    return np.eye(places.frame.max() + 1, dtype=np.float32)[shown]


def compared(places, **descriptors):
    return report.compare(descriptors, places, None, TOLERANCE, sequence_length=3, size=(8, 12))


def test_recall_without_frames_that_are_flat_or_stand():
    """Frames 4 to 6 show one picture, 9 shows nothing; of 12, 4, 5 and 9 are wrong, and 11 too."""
    places = ride(("summer", "winter"), 12, same=(5, 6), flat=(9,))
    (found,) = compared(places, network=by_frame(places, wrong=(4, 5, 9, 11)))
    assert np.flatnonzero(found.stopped).tolist() == [4, 5, 6]
    assert np.flatnonzero(found.flat).tolist() == [9]
    assert np.flatnonzero(~found.moving).tolist() == [4, 5, 6, 9]
    (row,) = report.table([found], 3)
    assert (row["R@1"], row["R@1 not flat"], row["R@1 moving"]) == ("66.7", f"{100 * 8 / 11:.1f}", f"{100 * 7 / 8:.1f}")
    metrics = report.metrics([found], report.posteriors_of([found], 0.1))
    assert metrics["test/R_at_1_moving_pm1f_winter_to_summer"] == pytest.approx(7 / 8)
    assert metrics["test/R_at_1_not_flat_pm1f_winter_to_summer"] == pytest.approx(8 / 11)
    arrays = report.arrays([found])
    assert arrays["stopped_pm1f_winter_to_summer"].sum() == 3
    assert arrays["R@1_pm1f_winter_to_summer/network"][found.moving].mean() == pytest.approx(7 / 8)


def test_the_ceiling_is_that_of_the_stop_and_is_kept_under_the_name_of_its_figure():
    """Of the three frames that stand, all have two or three positives of three within one frame: 2, 3 and 2."""
    places = ride(("summer", "winter"), 12, same=(5, 6))
    found = compared(places, network=by_frame(places))
    assert report.ceilings(found) == {"R@1_pm1f_winter_to_summer": pytest.approx((9 + 7 / 3) / 12)}


def test_nothing_is_left_out_where_all_moves_and_all_where_nothing_does():
    places = ride(("summer", "winter"), 6)
    (found,) = compared(places, network=by_frame(places))
    assert found.ceiling == 1
    assert not any("moving" in name for name in report.metrics([found], report.posteriors_of([found], 0.1)))
    still = ride(("summer", "winter"), 6, same=range(1, 6))
    (found,) = compared(still, network=by_frame(still))
    assert report.table([found], 3)[0]["R@1 moving"] == "–"


@pytest.mark.parametrize("drives", [True, False])
def test_only_the_frames_of_drives_are_matched_as_sequences(drives):
    places = replace(ride(("summer", "winter"), 12), drives=drives)
    found = compared(places, network=by_frame(places))
    figures = [*report.metrics(found, None), *report.arrays(found), *report.table(found, 3)[0]]
    assert any("seq" in name for name in figures) == drives
    assert places.select(np.arange(6)).drives == drives


def test_all_pairs_agree_with_the_report_where_it_has_them():
    places = ride(("summer", "winter", "fog"), 10)
    descriptors = by_frame(places, wrong=(2, 7, 8))
    pairs = condition_pairs(descriptors, places, TOLERANCE)
    metrics, arrays = pair_metrics(pairs, TOLERANCE), pair_arrays(pairs, TOLERANCE)
    assert len(metrics) == 3 * 2 + 1
    for found in compared(places, network=descriptors):
        name = report.logged_name(found.protocol.name("R@1"))
        assert metrics[name] == found.methods["network"].hit.mean() < 1
    assert metrics["test/R_at_1_across_pm1f"] == pytest.approx(np.mean([v for k, v in metrics.items() if "_to_" in k]))
    assert arrays["R@1_pm1f/pairs/conditions"].tolist() == ["summer", "winter", "fog"]
    assert arrays["R@1_pm1f/pairs/recall"][2, 0] == metrics["test/R_at_1_pm1f_fog_to_summer"]
    assert arrays["R@1_pm1f/pairs/queries"].tolist() == [[10] * 3] * 3
    assert not arrays["R@1_pm1f/pairs/queries_without_positive"].any()


def test_all_pairs_round_as_the_report_does():
    """Frames 50 apart look alike but for their length, so that only rounding says which of the two is found."""
    places, rng = ride(("summer", "winter"), 100), np.random.default_rng(0)
    looks = np.tile(rng.normal(size=(50, 128)), (4, 1)) * rng.uniform(0.5, 2, (200, 1))
    looks[150:] = rng.normal(size=(50, 128))
    descriptors = looks.astype(np.float32)
    pairs = pair_metrics(condition_pairs(descriptors, places, TOLERANCE), TOLERANCE)
    (found,) = compared(places, network=descriptors)
    assert pairs["test/R_at_1_pm1f_winter_to_summer"] == found.methods["network"].hit.mean()


def test_figures_of_a_drive_whose_name_has_a_slash_are_saved(tmp_path):
    places = ride(("day", "night/rain"), 4)
    descriptors = by_frame(places)
    pairs = condition_pairs(descriptors, places, TOLERANCE)
    for name, figure in report.figures(compared(places, network=descriptors), places, pairs):
        save_figure(figure, tmp_path, name)
    assert {f"{kind}_night_rain.png" for kind in ("precision_recall", "similarity", "gallery")} < {
        path.name for path in tmp_path.iterdir()
    }


# -- factors -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("fog_per_m=0.02", ("fog_per_m", 0.02)), ("exposure_ev=-1.5", ("exposure_ev", -1.5)), ("x=1e-05", ("x", 1e-5)),
        ("x=.", None), ("summer_noon", None), ("a=b", None), ("=1", None), ("fog=1_again", None), ("x=nan", None),
    ],
)  # fmt: skip
def test_a_factor_is_read_from_a_name(name, found):
    assert factor_of(name) == found
    assert has_factors(["summer", name]) == (found is not None)


CONDITIONS = ("summer_noon", "summer_noon_again", "snow=0.5", "snow=1", "sun_elevation_deg=10", "made_up=7")


@pytest.fixture(scope="module")
def tested():
    places = ride(CONDITIONS, 10)
    noise = by_frame(places)
    noise[places.traverse == 3] = np.eye(10, dtype=np.float32)[0]  # snow=1 looks like the first place everywhere
    return compared(places, pixels=noise, network=by_frame(places, wrong=(9,)))


def test_curves_hold_the_recall_of_each_condition_and_of_the_map_again(tested):
    found = invariance(tested)
    assert found.own == {"snow": 0.0, "sun_elevation_deg": 52.0}
    assert found.metric == "recall@1_pm1f, in summer_noon"
    assert list(found.curves) == ["snow", "sun_elevation_deg", "made_up"]
    snow = found.curves["snow"]
    assert list(snow) == ["pixels", "network"]
    assert snow["pixels"].values.tolist() == [0, 0.5, 1]
    assert snow["pixels"].recall.tolist() == [1, 1, 0.2]
    assert snow["network"].recall.tolist() == [0.9] * 3
    assert found.curves["sun_elevation_deg"]["network"].values.tolist() == [10, 52]
    assert found.curves["made_up"]["network"].values.tolist() == [7]  # the map's own value is not known
    facts = invariance_facts(found)["factors"]["snow"]["pixels"]
    assert facts["recall"] == [1, 1, 0.2]
    assert facts["low"][2] < 0.2 < facts["high"][2]


def test_their_table_metrics_and_figure(tested, tmp_path):
    found = invariance(tested)
    rows = invariance_table(found)
    assert len(rows) == 3 * 2
    assert {
        "factor": "snow",
        "method": "pixels",
        "R@1, mean of values": "73.3",
        "lowest": "20.0",
        "at": "1",
    }.items() <= (rows[0].items())
    metrics = invariance_metrics(tested)
    assert metrics["test/R_at_1_pm1f_snow_0.5_to_summer_noon"] == pytest.approx(0.9)
    assert not any(set(name) - set("abcdefghijklmnopqrstuvwxyzR0123456789_-./") for name in metrics)
    figure = invariance_figure(found)
    assert [axes.get_xlabel() for axes in figure.axes[:3]] == ["snow", "sun elevation deg", "made up"]
    assert save_figure(figure, tmp_path, "curves")[0].stat().st_size > 1000


def test_conditions_without_factors_have_no_curves():
    places = ride(("summer", "winter"), 6)
    with pytest.raises(ValueError, match="no condition is named by a factor"):
        invariance(compared(places, network=by_frame(places)))


def test_a_larger_map_keeps_the_temperature_from_zero():
    """Every validation query is right, and then nearly every one among places from elsewhere."""
    rng = np.random.default_rng(0)
    first = rng.normal(size=(20, 8))
    descriptors = np.concatenate([first, first + 0.5 * rng.normal(size=first.shape)]).astype(np.float32)
    images = ImageRows(np.zeros((40, 2, 2, 3), np.uint8))
    frame = np.tile(np.arange(20), 2)
    places = PlaceImages(
        images, np.repeat([0, 1], 20), ("day", "night"), frame, tuple(f"{k}" for k in range(40)), aligned=True
    )
    tolerance = PlaceTolerance("frames", 0, 1)
    alone = report.temperature(descriptors, places, tolerance)
    among = report.temperature(descriptors, places, tolerance, rng.normal(size=(2000, 8)).astype(np.float32))
    assert among > 2 * alone
