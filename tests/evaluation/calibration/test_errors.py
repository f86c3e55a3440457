"""Errors of cameras against closed forms and rotation matrices; summaries against definitions written out."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from sextant.chapters.calibration.metrics.errors import ERRORS, calibration_errors
from sextant.chapters.calibration.metrics.summary import AUC_OF, auc, cluster_resamples, methods_table, summary
from sextant.geometry import CameraParameters, PerspectiveCamera, k2_of_k1

N = 40


def cameras(seed=0, count=N, dtype=torch.float64):
    g = np.random.default_rng(seed)
    columns = (g.uniform(-0.6, 0.6, count), g.uniform(-0.6, 0.6, count), g.uniform(0.5, 1.4, count))
    return CameraParameters(*(torch.tensor(c, dtype=dtype) for c in (*columns, g.uniform(-0.4, 0, count))))


ASPECT = torch.linspace(0.75, 16 / 9, N, dtype=torch.float64)


def errors_of(change, truth=None):
    truth = cameras() if truth is None else truth
    return calibration_errors(change(truth), truth, ASPECT)


def test_the_truth_has_no_error():
    for name, values in errors_of(lambda truth: truth).items():
        assert np.abs(values).max() < 1e-12, name


def test_errors_are_named_with_their_unit_and_one_an_image():
    errors = calibration_errors(cameras(1, dtype=torch.float32), cameras(2, dtype=torch.float32), ASPECT.float())
    assert tuple(errors) == ERRORS
    for values in errors.values():
        assert values.shape == (N,)
        assert values.dtype == np.float64
        assert (values >= 0).all()


def test_plain_errors_in_their_units():
    errors = errors_of(lambda t: CameraParameters(t.tilt - 0.1, t.roll + 0.2, 0.9 * t.focal, t.k1 + 0.03))
    np.testing.assert_allclose(errors["tilt_deg"], np.degrees(0.1))
    np.testing.assert_allclose(errors["roll_deg"], np.degrees(0.2))
    np.testing.assert_allclose(errors["focal_percent"], 10)
    np.testing.assert_allclose(errors["k1"], 0.03)


def test_field_of_view_and_apparent_distortion_by_the_camera_class():
    one = CameraParameters(*(torch.tensor([v], dtype=torch.float64) for v in (0, 0, 0.5, -0.4)))
    other = CameraParameters(*(torch.tensor([v], dtype=torch.float64) for v in (0, 0, 1.0, -0.2)))
    errors = calibration_errors(one, other, torch.ones(1, dtype=torch.float64))
    views = [PerspectiveCamera(c.focal, c.k1, k2_of_k1(c.k1), 100, 100) for c in (one, other)]
    nominal, true = ([np.degrees(getattr(v, name).item()) for v in views] for name in ("vfov", "true_vfov"))
    assert nominal == pytest.approx([90.0, 53.13], abs=0.01)
    assert errors["vfov_deg"] == pytest.approx([nominal[0] - nominal[1]])
    assert true == pytest.approx([110.6, 55.7], abs=0.1)
    assert errors["true_vfov_deg"] == pytest.approx([true[0] - true[1]])
    assert errors["k1_hat"] == pytest.approx([1.4])


def test_rolls_that_differ_by_a_turn_are_equal():
    truth = cameras()._replace(roll=torch.full((N,), 3.1, dtype=torch.float64))
    errors = errors_of(lambda t: t._replace(roll=t.roll - 2 * np.pi + 0.05), truth)
    np.testing.assert_allclose(errors["roll_deg"], np.degrees(0.05))


@pytest.mark.slow
@given(st.integers(0, 10**6))
def test_bearing_error_is_the_mean_angle_between_rays_of_scipy_rotations(seed):
    truth, predicted = cameras(seed, 3), cameras(seed + 1, 3)
    found = calibration_errors(predicted, truth, ASPECT[:3])["bearing_deg"]
    for i in range(3):
        grid = np.stack(np.meshgrid(np.linspace(-0.5, 0.5, 15) * ASPECT[i].item(), np.linspace(-0.5, 0.5, 15)), -1)
        rays = []
        for tilt, roll, focal, k1 in (tuple(c[i].item() for c in camera) for camera in (predicted, truth)):
            k2 = 0.019 * k1 + 0.805 * k1**2
            distorted = np.linalg.norm(grid, axis=-1) / focal
            table = np.linspace(0, 3.2, 200_001)  # undistortion by looking the radius up, before any fold
            radius = np.interp(distorted, table * (1 + k1 * table**2 + k2 * table**4), table)
            plane = grid / focal * (radius / np.maximum(distorted, 1e-9))[..., None]
            ray = np.concatenate([plane, np.ones_like(plane[..., :1])], -1).reshape(-1, 3)
            turn = Rotation.from_euler("x", tilt) * Rotation.from_euler("z", roll)
            rays.append(turn.apply(ray / np.linalg.norm(ray, axis=1, keepdims=True)))
        angle = np.arctan2(np.linalg.norm(np.cross(*rays), axis=1), (rays[0] * rays[1]).sum(1))
        assert found[i] == pytest.approx(np.degrees(angle).mean(), rel=1e-6)


def test_tilt_error_turns_every_ray_by_at_most_itself():
    errors = errors_of(lambda t: t._replace(tilt=t.tilt + 0.02))
    assert (errors["bearing_deg"] < np.degrees(0.02)).all()
    assert (errors["bearing_deg"] > 0.6 * np.degrees(0.02)).all()


def test_undistortion_error_sees_no_pose_and_no_focal_length_of_equal_bend():
    def changed(t):
        focal = 1.2 * t.focal
        return CameraParameters(t.tilt + 0.3, t.roll - 0.3, focal, t.k1 / t.focal.square() * focal.square())

    truth = cameras()
    bend = calibration_errors(changed(truth), truth, ASPECT, k2_of_k1="zero")["undistortion_px"]
    reachable = truth.k1 / truth.focal.square() > -0.3  # without k2 the rest has points of the image beyond the fold
    assert reachable.sum() > 10
    assert bend[reachable.numpy()].max() < 1e-9
    assert errors_of(changed)["undistortion_px"].max() < 10
    straight = errors_of(lambda t: t._replace(k1=torch.zeros_like(t.k1)))["undistortion_px"]
    assert np.median(straight) > 10


def test_undistortion_error_to_first_order_is_the_moment_of_the_image():
    """For weak distortion U(p) = p (1 - k1_hat R²): the error is 480 |dk1_hat| mean(R³) over the grid."""
    truth = cameras()._replace(k1=torch.zeros(N, dtype=torch.float64))
    small = 1e-6
    errors = calibration_errors(truth._replace(k1=small * truth.focal.square()), truth, ASPECT, k2_of_k1="zero")
    line = np.linspace(-0.5, 0.5, 15)
    cubes = [(np.hypot(*np.meshgrid(line * a, line)) ** 3).mean() for a in ASPECT.numpy()]
    np.testing.assert_allclose(errors["undistortion_px"], 480 * small * np.array(cubes), rtol=1e-4)


def test_what_a_method_cannot_tell_has_no_error():
    nan = torch.full((N,), torch.nan, dtype=torch.float64)
    errors = errors_of(lambda t: CameraParameters(t.tilt, t.roll, nan, torch.zeros_like(t.k1)))
    assert np.isfinite(errors["tilt_deg"]).all()
    assert np.isfinite(errors["k1"]).all()
    assert np.isnan(errors["vfov_deg"]).all()
    assert np.isnan(errors["bearing_deg"]).all()


# -- areas under the recall curve --------------------------------------------------------------------------------------


def area_by_definition(errors, threshold, full_below):
    """The integral of the curve, drawn knot by knot as GeoCalib's evaluation does, by adaptive quadrature."""
    ordered = np.sort(np.where(np.isnan(errors), np.inf, errors))
    recall = np.arange(1, len(ordered) + 1) / len(ordered)
    later = (ordered > full_below) & (ordered <= threshold)
    start = (ordered <= full_below).mean()
    end = (ordered <= threshold).mean()
    knots = np.concatenate([[0, full_below], ordered[later], [threshold]])
    values = np.concatenate([[start, start], recall[later], [end]])
    pieces = zip(knots, knots[1:], values, values[1:], strict=False)
    return sum(quad(lambda x, a, b, y, z: y + (z - y) * (x - a) / (b - a), *p[:2], args=p)[0]
               for p in pieces if p[1] > p[0]) / threshold  # fmt: skip


@given(
    st.lists(st.floats(0, 15) | st.just(np.nan) | st.sampled_from([1.0, 5.0, 10.0]), min_size=1, max_size=25),
    st.sampled_from([(1.0, 1.0), (5.0, 1.0), (10.0, 1.0), (5.0, 0.0), (3.0, 0.0)]),
)
def test_the_area_is_the_integral_of_its_curve(errors, limits):
    threshold, full_below = limits
    expected = area_by_definition(np.array(errors), threshold, full_below)
    assert auc(np.array(errors), threshold, full_below) == pytest.approx(expected, abs=1e-9)


def test_the_area_of_two_errors_by_hand():
    # recall 1/2 up to 1 degree, then a ramp to 1 at 3, flat to 5: (0.5 + 1.5 + 2) / 5
    assert auc(np.array([0.2, 3.0]), 5.0) == pytest.approx(0.8)
    assert auc(np.array([0.2, 3.0]), 1.0) == 0.5
    # without the step at 1: a ramp to 1/2 at 0.2, to 1 at 3, flat to 5: (0.05 + 2.1 + 2) / 5
    assert auc(np.array([0.2, 3.0]), 5.0, full_below=0.0) == pytest.approx(0.83)


def test_the_area_at_one_degree_is_a_share():
    errors = np.random.default_rng(0).exponential(2, 500)
    assert auc(errors, 1.0) == pytest.approx((errors <= 1).mean())


def test_a_threshold_below_the_step_means_nothing():
    with pytest.raises(ValueError, match=r"at least 1\.0"):
        auc(np.array([0.5]), 0.5)


# -- summaries ---------------------------------------------------------------------------------------------------------


def panorama_errors(seed, panoramas=30, crops=8, share=0.7):
    """Errors whose logarithms have standard deviation 1, most of it between panoramas."""
    g = np.random.default_rng(seed)
    logs = np.sqrt(share) * g.normal(size=(panoramas, 1)) + np.sqrt(1 - share) * g.normal(size=(panoramas, crops))
    return np.exp(logs).ravel(), np.repeat(np.arange(panoramas), crops)


def test_values_are_those_of_numpy():
    errors, panoramas = panorama_errors(0)
    found = summary({"tilt_deg": errors, "k1": errors}, panoramas)
    assert found["tilt_deg"].median.value == np.median(errors)
    assert found["tilt_deg"].mean.value == pytest.approx(errors.mean())
    assert {t: a.value for t, a in found["tilt_deg"].auc.items()} == {t: auc(errors, t) for t in (1.0, 5.0, 10.0)}
    assert (found["k1"].auc, found["k1"].images, found["k1"].panoramas) == ({}, 240, 30)


@pytest.mark.parametrize("seed", range(5))
def test_each_resample_is_what_drawing_the_crops_of_whole_panoramas_gives(seed):
    """Intervals from sums over panoramas equal those of a bootstrap that copies the crops."""
    errors, panoramas = panorama_errors(3, panoramas=6, crops=3)
    errors[4] = np.nan
    kept = ~np.isin(np.arange(18), [1, 2, 9])  # panoramas of unequal numbers of crops
    errors, panoramas = errors[kept], panoramas[kept] + 40  # whose names need not start at 0
    found = summary({"tilt_deg": errors}, panoramas, resamples=60, seed=seed)["tilt_deg"]
    infinite = np.where(np.isnan(errors), np.inf, errors)
    statistics = []
    for counts in cluster_resamples(panoramas - 40, 60, seed):
        drawn = np.repeat(infinite, counts[panoramas - 40])
        known = drawn[np.isfinite(drawn)]
        statistics.append([np.median(drawn), known.mean(), *(auc(drawn, t) for t in (1.0, 5.0, 10.0))])
    low, high = np.quantile(statistics, [0.025, 0.975], axis=0, method="inverted_cdf")
    estimates = [found.median, found.mean, *found.auc.values()]
    np.testing.assert_allclose([e.low for e in estimates], low)
    np.testing.assert_allclose([e.high for e in estimates], high)


@pytest.mark.slow
@pytest.mark.parametrize("statistic", ["mean", "median", "auc"])
def test_intervals_hold_the_truth_as_often_as_they_say_and_those_over_crops_do_not(statistic):
    def value(of):
        return of.auc[5] if statistic == "auc" else getattr(of, statistic)

    many = np.exp(np.random.default_rng(99).normal(size=400_000))
    truth = {"mean": np.exp(0.5), "median": 1.0, "auc": auc(many, 5.0)}[statistic]
    held = np.zeros(2)
    for seed in range(150):
        errors, panoramas = panorama_errors(seed, panoramas=40)
        for kind, clusters in enumerate((panoramas, np.arange(len(errors)))):
            estimate = value(summary({"tilt_deg": errors}, clusters, resamples=200, seed=seed)["tilt_deg"])
            held[kind] += (estimate.low <= truth <= estimate.high) / 150
    assert 0.87 <= held[0] <= 1
    assert held[1] < 0.75


def test_what_was_not_answered_counts_against_a_method():
    errors, panoramas = panorama_errors(1)
    silent = np.where(np.arange(len(errors)) % 3 == 0, np.nan, errors)
    full, partial = (summary({"tilt_deg": e}, panoramas)["tilt_deg"] for e in (errors, silent))
    assert partial.answered == pytest.approx(2 / 3)
    assert partial.median.value > full.median.value
    assert partial.auc[10].value < 0.67
    assert partial.mean.value == pytest.approx(np.nanmean(silent))
    mute = summary({"tilt_deg": np.full(len(errors), np.nan)}, panoramas)["tilt_deg"]
    assert (mute.answered, mute.median.value, mute.auc[5].value) == (0, np.inf, 0)
    assert np.isnan([mute.mean.value, mute.mean.low]).all()


def test_one_panorama_has_no_interval():
    found = summary({"k1": np.arange(5.0)}, np.zeros(5, np.int64))["k1"]
    assert found.median.value == 2
    assert np.isnan([found.median.low, found.mean.high]).all()


@pytest.mark.parametrize("panoramas", [np.zeros(0, np.int64), np.zeros(3, np.int64)])
def test_images_without_panorama_are_refused(panoramas):
    with pytest.raises((ValueError, TypeCheckError), match="panorama"):
        summary({"k1": np.zeros(5)}, panoramas)


def test_the_table_has_a_row_for_every_method():
    errors = calibration_errors(cameras(1), cameras(2), ASPECT)
    half = np.where(np.arange(N) % 2, np.nan, errors["bearing_deg"])
    silent = errors | {"vfov_deg": np.full(N, np.nan), "bearing_deg": half}
    panoramas = np.arange(N) // 4
    methods = {"ours": summary(errors, panoramas), "lines": summary(silent, panoramas)}
    titles, rows = methods_table(methods)
    assert all(len(row) == len(titles) for row in rows)
    cells = [dict(zip(titles, row, strict=True)) for row in rows]
    assert [c["method"] for c in cells] == ["ours", "lines"]
    assert cells[0]["tilt (°)"] == f"{np.median(errors['tilt_deg']):.2f}"
    assert cells[1]["vfov (°)"] == cells[1]["vfov AUC@1/5/10"] == "–"
    assert [c["answered (%)"] for c in cells] == ["100", "50"]
    _, lone = methods_table({"plumb line": {"k1_hat": methods["ours"]["k1_hat"]}})
    assert (lone[0][1], lone[0].count("–")) == ("100", len(titles) - 3)
    assert [f"{n.removesuffix('_deg')} AUC@1/5/10" in titles for n in AUC_OF] == [True] * 4
