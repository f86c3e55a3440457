"""Reports of made-up runs under a published set of corruptions, with numbers worked out by hand."""

import csv
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_sweep import IMAGES, PROTOCOL, MadeUpRun, made_up_sweep, predictions
from scipy import stats

from sextant.chapters.classification.report import baseline_of
from sextant.evaluation import ALEXNET_CIFAR10_C, ALL_19, BENCHMARK_15
from sextant.kit.measure import SharedSet, classified, shared_set
from sextant.reports.contrasts import contrasts
from sextant.reports.corruption_contrasts import OverSeeds, arm_errors, corruption_contrasts
from sextant.reports.corruption_report import corruption_section
from sextant.reports.corruption_tables import difference_table, overview_table, score_table
from sextant.reports.sweep_report import write_report

# errors of 20 images: clean 5 %; fog 10 and 20 %, gaussian noise 25 %; E = (15 + 25) / 2 = 20 %
WRONG = {"clean": 1, "fog/1": 2, "fog/2": 4, "gaussian_noise/1": 5}
EFFECT = {
    "contrasts": {
        "effect": {"treatment": "b", "control": "a"},
        "seeds": {"treatment": "twin", "control": "a"},
    },
    "noise_floor": "seeds",
}


def changed(fog=0, noise=0, clean=0, **other):
    """A run that has so many more images wrong than ``WRONG`` at every severity."""
    more = {"clean": clean, "fog": fog, "gaussian_noise": noise}
    return MadeUpRun({key: count + more[key.split("/")[0]] for key, count in WRONG.items()}, **other)


@pytest.fixture
def sweep(tmp_path):
    """Pair 3 of b diverged; over pairs 0 to 2 b - a is -2, -1, -3 images in noise and 0, +1, +2 in fog."""
    arms = {
        "a": [changed(), changed(noise=1), changed(noise=2, clean=1), changed()],
        "b": [changed(noise=-2), changed(fog=1), changed(noise=-1, fog=2), changed(10, 10, 10, outcome="diverged")],
        "twin": [changed(fog=1), changed(noise=1, fog=1), changed(noise=2), changed()],
    }
    return made_up_sweep(tmp_path, arms, **EFFECT)


def test_many_conditions_become_the_error_on_clean_and_on_corrupted_images(sweep):
    assert sweep.conditions == ["clean", "corrupted"]
    first = sweep.of("net", "a")[0]
    assert (first.value("clean"), first.value("corrupted")) == pytest.approx((5, 20))
    assert sweep.measure.better == "lower"
    # image 0 is always wrong, image 3 at fog/2 and under noise, image 4 under noise alone, image 5 never
    assert first.values["corrupted"][[0, 3, 4, 5]] == pytest.approx([100, 75, 50, 0])


def test_a_corruption_counts_once_however_many_severities_it_has(sweep):
    (errors,) = arm_errors(sweep)[0].runs[:1]
    assert errors.by_corruption() == pytest.approx({"fog": 0.15, "gaussian_noise": 0.25})


@given(st.data())
def test_the_mean_over_images_is_the_mean_over_corruptions(data):
    counts = st.integers(0, IMAGES)
    severities = {name: tuple(range(1, data.draw(st.integers(1, 5)) + 1)) for name in ("fog", "snow", "stripe")}
    shared = SharedSet((("cifar10_c", ""),), severities)
    found = classified(predictions({key: data.draw(counts) for key in shared.keys}), shared)
    assert found.by_condition["corrupted"].mean() == pytest.approx(100 * found.errors.mean())
    assert found.by_condition["clean"].mean() == pytest.approx(100 * found.errors.clean)


@pytest.mark.parametrize(("names", "expected"), [(ALL_19, True), (BENCHMARK_15, False), (ALL_19[5:], False)])
def test_the_benchmarks_15_are_told_apart_where_there_are_more(names, expected):
    shared = SharedSet((("cifar10_c", ""),), dict.fromkeys(names, (3,)))
    wrong = {"clean": 0} | {f"{name}/3": 2 if name in BENCHMARK_15 else 6 for name in names}
    found = classified(predictions(wrong), shared).by_condition
    assert ("benchmark 15" in found) is expected
    if expected:
        assert found["benchmark 15"].mean() == pytest.approx(10)
        assert found["corrupted"].mean() == pytest.approx((15 * 10 + 4 * 30) / 19)


def test_holm_is_over_the_summaries_alone(sweep):
    rows = [row for row in contrasts(sweep) if row.contrast == "effect"]
    assert [row.condition for row in rows] == ["clean", "corrupted"]
    # corrupted, in points: half the difference in noise and half that in fog, one image of 20 being 5 points
    expected = np.array([-5.0, 0.0, -2.5])
    assert rows[1].paired.mean == pytest.approx(expected.mean())
    assert (rows[1].paired.wins, rows[1].paired.seeds, rows[1].dropped) == (2, 3, 1)
    assert rows[1].paired.image_low < rows[1].paired.image_high


def test_a_contrast_by_corruption_is_over_pairs_in_which_both_runs_converged(sweep):
    effect, seeds = corruption_contrasts(sweep)
    assert (effect.pairs, effect.dropped, effect.is_floor, seeds.is_floor) == (3, 1, False, True)
    noise, fog = (effect.differences.by_corruption[name] for name in ("gaussian_noise", "fog"))
    expected = {"gaussian_noise": np.array([-0.10, -0.05, -0.15]), "fog": np.array([0, 0.05, 0.10])}
    for name, found in (("gaussian_noise", noise), ("fog", fog)):
        test = stats.ttest_1samp(expected[name], 0).confidence_interval()
        assert (found.mean, found.low, found.high) == pytest.approx((expected[name].mean(), test.low, test.high))
    assert (effect.won_pairs("gaussian_noise"), effect.won_pairs("fog"), effect.won_pairs()) == (3, 0, 2)
    assert (effect.differences.wins, effect.differences.losses) == (1, 1)
    # the floor has all four pairs: fog 1, 1, 0, 0 images more
    assert effect.floor.by_corruption["fog"].mean == pytest.approx(0.025)
    assert seeds.floor is None


def test_tables_give_per_cent_of_the_pairs(sweep):
    effect = corruption_contrasts(sweep)[0]
    noise, fog, mean = difference_table(effect).rows
    # control: noise 25, 30, 35 %; fog 15, 15, 15 %; treatment: noise 15, 25, 20 %; fog 15, 20, 25 %
    assert noise[:5] == ["noise", "gaussian noise", "30.00", "20.00", "-10.00"]
    assert fog[:5] == ["weather", "fog", "15.00", "20.00", "+5.00"]
    assert mean[1:5] == ["**mean of 2**", "22.50", "20.00", "-2.50"]
    assert [row[6] for row in (noise, fog, mean)] == ["3/3", "0/3", "2/3"]
    # of t tests of (-2, -1, -3) and (0, 1, 2) images, p = 0.0742 and 0.2254; Holm doubles the lesser
    assert [row[7] for row in (noise, fog, mean)] == ["0.1484", "0.2254", "–"]
    assert fog[8].startswith("+2.50 [")
    overview, floor = overview_table(corruption_contrasts(sweep)).rows
    assert overview[:7] == ["net", "b minus a", "3†", "1", "22.50", "20.00", "-2.50"]
    assert overview[8:] == ["2/3", "1/2", "1/2", "0/2", "0/2", "0/2", "0/2"]
    assert floor[1] == "twin minus a (noise floor)"


def test_corruption_errors_are_relative_to_the_sets_baseline(tmp_path):
    wrong = {"clean": 2} | {f"fog/{severity}": severity for severity in range(1, 6)}  # clean 10 %, fog 15 %
    other = {"clean": 2} | {f"fog/{severity}": severity + 1 for severity in range(1, 6)}  # fog 20 %
    results = made_up_sweep(tmp_path, {"a": [MadeUpRun(wrong), MadeUpRun(other)]})
    baseline = baseline_of(results.shared.key, results.shared.severities)
    assert baseline == ALEXNET_CIFAR10_C  # fog 30.31 %, clean 13.87 %
    (row,) = score_table(arm_errors(results), baseline, {"of 1": ("fog",)}).rows
    setting, arm, seeds, clean, mce, relative = row
    assert (setting, arm, seeds) == ("net", "a", "2")
    assert clean == "10.00 ± 0.00 –"
    assert mce.split(" [")[0] == "57.74 ± 11.66"  # of 49.49 and 65.98
    assert relative.split(" [")[0] == "45.62 ± 21.51"  # of 30.41 and 60.83
    text = corruption_section(results).text
    assert "### Beside AlexNet on CIFAR-10-C" in text
    assert "one that errs more on clean images has less to lose, and a lower relative mCE" in text


def test_there_is_no_score_without_a_baseline_or_with_missing_severities(sweep):
    assert baseline_of(sweep.shared.key, sweep.shared.severities) is None
    whole = {"fog": (1, 2, 3, 4, 5)}
    assert baseline_of("cifar10_c", whole) is not None
    assert baseline_of("mnist_c", whole) is None
    assert baseline_of(SharedSet((("cifar10_c", ""), ("imagenet_c", "")), whole).key, whole) is None
    assert baseline_of("cifar10_c", {**whole, "stripe": (1, 2, 3, 4, 5)}) is None


def test_what_only_some_runs_were_tested_under_is_left_out_and_told():
    shared = shared_set([PROTOCOL, PROTOCOL], [["clean", "fog/1", "fog/3", "snow/1"], ["clean", "fog/3"]])
    assert shared.keys == ["clean", "fog/3"]
    assert shared.left_out == 2
    assert shared_set([PROTOCOL, None], [["clean", "fog/1"], ["clean", "fog/1"]]) is None
    assert shared_set([PROTOCOL, PROTOCOL], [["clean", "fog/1"], ["clean", "snow/1"]]) is None
    assert shared_set([], []) is None


def test_different_images_under_one_name_are_warned_of(tmp_path):
    other = changed(protocol={**PROTOCOL, "mode": "corrected"})
    section = corruption_section(made_up_sweep(tmp_path, {"a": [changed()], "b": [other]}))
    assert "CIFAR-10-C, faithful, 8 bits, seed 0; or CIFAR-10-C, corrected, 8 bits, seed 0" in section.text
    assert "their errors cannot be compared" in section.text


def test_runs_without_a_protocol_are_reported_as_accuracies(tmp_path):
    results = made_up_sweep(tmp_path, {"a": [changed(protocol=None)], "b": [changed()]})
    assert (results.shared, results.measure.quantity) == (None, "accuracy")
    assert results.conditions == list(WRONG)
    assert results.of("net", "b")[0].value("fog/1") == pytest.approx(90)
    assert not corruption_section(results).text
    with pytest.raises(ValueError, match="not tested under a published set"):
        corruption_contrasts(results)


@pytest.mark.slow
def test_published_accuracies_become_errors(tmp_path):
    published = {"net": {"a": {"clean": 90.0}, "b": {"clean": 99.0}}}
    results = made_up_sweep(tmp_path, {"a": [changed()], "b": [changed()]}, published=published)
    assert results.published("net", "a", "clean") == pytest.approx(10)
    (row,) = (row for row in contrasts(results) if row.condition == "clean")
    assert row.published == pytest.approx(-9)
    write_report(results)
    assert "## Clean error beside the published" in (results.directory / "report" / "report.md").read_text()


@pytest.mark.slow
def test_the_report_shows_summaries_and_every_picture_that_it_names(sweep):
    paths = {path.name for path in write_report(sweep)}
    text = (sweep.directory / "report" / "report.md").read_text()
    assert "| setting | arm | clean | corrupted |" in text
    assert "| setting | arm | seeds | diverged | failed | missing |" in text
    assert "Difference in error (points), paired by seed, on the same test images; lower is better" in text
    named = set(re.findall(r"\]\(([^)]+\.png)\)", text))
    assert named == {
        "corruption_difference_net_effect.png",
        "corruption_difference_net_seeds.png",
        *(f"corruption_heatmap_net_{arm}.png" for arm in ("a", "b", "twin")),
    }  # two corruptions make no radar chart
    assert named <= paths
    rows = list(csv.DictReader((sweep.directory / "report" / "corruption_contrasts.csv").open()))
    mean = next(row for row in rows if (row["contrast"], row["corruption"]) == ("effect", "mean"))
    assert float(mean["difference"]) == pytest.approx(-2.5)
    assert (mean["pairs"], mean["dropped"], mean["pairs_won"]) == ("3", "1", "2")
    errors = list(csv.DictReader((sweep.directory / "report" / "corruptions.csv").open()))
    found = {(row["arm"], row["corruption"], row["severity"]): float(row["error"]) for row in errors}
    # b converged thrice: fog/2 has 4, 5, 6 of 20 images wrong
    assert (found["b", "fog", "2"], found["a", "clean", ""]) == pytest.approx((25, 6.25))


def test_three_corruptions_make_a_radar_chart_of_every_setting(tmp_path):
    wrong = {**WRONG, "snow/1": 3}
    arms = {arm: [MadeUpRun(wrong, setting=setting) for setting in ("x", "y")] for arm in ("a", "b")}
    names = [name for name, _ in corruption_section(made_up_sweep(tmp_path, arms)).figures]
    assert [name for name in names if "radar" in name] == ["corruption_radar_x", "corruption_radar_y"]


@pytest.mark.slow
def test_one_seed_has_differences_without_intervals(tmp_path):
    results = made_up_sweep(tmp_path, {"a": [changed()], "b": [changed(noise=-1)]})
    (contrast,) = corruption_contrasts(results)
    assert difference_table(contrast).rows[0][4:] == ["-5.00", "–", "1/1", "–"]
    write_report(results)


def test_arms_that_never_converged_are_told_not_drawn(tmp_path):
    lost = changed(10, 10, 10, outcome="diverged")
    results = made_up_sweep(tmp_path, {"a": [changed(), changed()], "b": [lost, lost]})
    section = corruption_section(results)
    assert "b minus a: no pair of converged runs." in section.text
    assert [name for name, _ in section.figures] == ["corruption_heatmap_net_a"]
    (row,) = overview_table(corruption_contrasts(results)).rows
    assert row[:4] == ["net", "b minus a", "0†", "2"]
    write_report(results)
    nothing = OverSeeds.of([])
    assert all(np.isnan(value) for value in (nothing.mean, nothing.spread, nothing.low, nothing.high))
