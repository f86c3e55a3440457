"""The filter that a config of localization describes."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from sextant.chapters.localization.chapter import LocalizationChapter
from sextant.chapters.localization.chapter import test_settings as settings_of
from sextant.chapters.localization.metric_parts import check_camera
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.digest import digest
from sextant.errors import UserError
from sextant.localization.recovery import BayesRestart, MetricProposal

LINE = np.column_stack([np.arange(9.0), np.zeros(9), np.zeros(9)])


def filter_of(overrides, poses=LINE, unit="m"):
    config = validate(to_plain(compose(["task=localization", *overrides])))
    data = SimpleNamespace(drives=SimpleNamespace(map=SimpleNamespace(poses=poses), unit=unit))
    return settings_of(config, data).filter(torch.from_numpy(poses))


@pytest.mark.parametrize(
    ("overrides", "supported"), [([], True), (["filter.support=null"], False), (["observation=laser_field"], False)]
)
def test_cameras_are_asked_where_the_map_is_and_lasers_anywhere(overrides, supported):
    found = filter_of(overrides)
    assert (found.support is not None) is supported
    if found.support is not None:
        assert found.support.reach == pytest.approx(0.5)  # of a map every metre


def test_a_distance_from_images_is_refused_for_a_laser():
    config = validate(to_plain(compose(["task=localization", "observation=laser_field", "filter.support=3.5"])))
    with pytest.raises(UserError, match=r"filter.support=3.5 is a distance from the images of a map"):
        LocalizationChapter().source(config)


def test_poses_between_images_are_of_a_camera_and_keep_no_map():
    """No filter is left that a kept map could be localized with; the digest is that of configs without the key."""
    plain = to_plain(compose(["task=localization"]))
    config = validate(to_plain(compose(["task=localization", "filter=interpolated"])))
    data = SimpleNamespace(drives=SimpleNamespace(map=SimpleNamespace(poses=LINE), unit="m"))
    assert settings_of(config, data).best == 2
    assert LocalizationChapter().prediction_example(config) == ()
    earlier = {**plain, "filter": {key: value for key, value in plain["filter"].items() if key != "best"}}
    assert digest(plain) == digest(earlier) != digest(config.plain)
    laser = ["task=localization", "observation=laser_field", "filter.best=3"]
    with pytest.raises(UserError, match=r"filter.best=3: scans are compared with walls"):
        LocalizationChapter().check_parts(validate(to_plain(compose(laser))))


def test_outliers_and_how_far_images_are_apart_follow_the_config():
    assert filter_of([]).support.outliers == 0.01
    assert filter_of([]).apart is None
    found = filter_of(["filter.outliers=0.1", "filter.apart=2"], LINE * [5.0, 1, 1])
    assert (found.support.outliers, found.support.reach) == (0.1, pytest.approx(2.5))
    assert found.apart == pytest.approx((10.0, math.radians(40)))  # two spacings, or two turns that the map tells apart
    given = filter_of(["filter.outliers=0.1", "filter.support=3.5"]).support
    assert (given.outliers, given.reach, given.heading_reach) == (0.1, 3.5, filter_of([]).support.heading_reach)
    anywhere = filter_of(["filter.outliers=0.1", "filter.support=null"]).support
    assert (anywhere.outliers, anywhere.reach) == (0.1, math.inf)


@pytest.mark.parametrize(("spacing", "unit", "aside"), [(1.0, "m", 0.2), (5.0, "m", 1.0), (1.0, "frames", 0.0)])
def test_noise_of_odometry_follows_from_how_far_the_images_of_a_map_are_apart(spacing, unit, aside):
    motion = filter_of(["motion=spacing"], LINE * [spacing, 1, 1], unit).motion
    assert motion.if_unknown()[:2] == pytest.approx((2 * spacing, aside))
    assert motion.per_metre[0] * spacing == pytest.approx((0.3 * spacing) ** 2)  # over a spacing, three tenths of it


@pytest.mark.parametrize(("motion", "line"), [("railway", True), ("exponential", False), ("spacing", False)])
def test_what_no_step_would_mend_is_not_drawn(motion, line):
    along, across, heading = filter_of([f"motion={motion}"]).prior.sigmas
    assert along > 0
    assert (across == 0, heading == 0) == (line, line)


def test_a_filter_that_does_not_adapt_is_that_of_configs_without_the_key():
    plain = to_plain(compose(["task=localization"]))
    on = validate(to_plain(compose(["task=localization", "filter.adapts=true"])))
    earlier = {name: value for name, value in plain["filter"].items() if name not in ("adapts", "odds")}
    assert digest({**plain, "filter": earlier}) == digest(plain) != digest(on.plain)
    data = SimpleNamespace(drives=SimpleNamespace(map=SimpleNamespace(poses=LINE), unit="m"))
    assert (settings_of(validate(plain), data).adapts, settings_of(on, data).adapts) == (False, True)
    assert LocalizationChapter().summary(on)["filter"] == "1000 particles, start=uniform, adapts"


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["filter.odds=20"], "filter.odds=20 is of a filter that adapts: filter.adapts=true"),
        (["filter.adapts=true", "filter.odds=1"], "filter.odds"),
        (["filter.adapts=true", "filter=interpolated"], "filter.adapts=true: filter.best=2 averages poses"),
        (["filter.adapts=true", "observation=laser_beam"], "filter.adapts=true: a laser's scans do not change"),
    ],
)
def test_what_cannot_adapt_is_refused(overrides, told):
    with pytest.raises(UserError, match=told):
        LocalizationChapter().check_parts(validate(to_plain(compose(["task=localization", *overrides]))))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["local=xfeat"], "local: local features locate images only with filter.metric"),
        (["filter.metric=both"], "filter.metric=both: a saved map keeps no local features"),
        (
            ["filter.metric=both", "observation=laser_beam"],
            "filter.metric=both: a laser's scans have no local",
        ),
        (["filter.metric=proposal", "recovery=uniform"], "which recovery=UniformInjection does not follow"),
        (["filter.metric=both", "recovery.weigh_jitter=false"], "restarts must be weighted at their own poses"),
        (["filter.metric=both", "filter=interpolated"], "filter.best=2 averages poses without a filter"),
        (["filter.metric=both", "descriptor=files", "descriptor.folder=x"], "descriptor=files has no images"),
        (["filter.metric=some"], "filter.metric"),
        (["filter.metric=both", "recovery=sequence_restart"], "recovery.window=10 weighs restarts by several images"),
        (["filter.metric=both", "filter.adapts=true"], "density is known, which filter.adapts=true has not"),
        (["filter.metric=proposal", "motion=identity"], "which motion=IdentityMotion has not"),
    ],
)
def test_located_poses_are_refused_where_they_do_not_fit(overrides, message):
    with pytest.raises(UserError, match=re.escape(message)):
        LocalizationChapter().check_parts(validate(to_plain(compose(["task=localization", *overrides]))))


def test_located_poses_propose_beside_restarts_and_earlier_configs_keep_their_digest():
    assert isinstance(filter_of([]).recovery, BayesRestart)
    assert isinstance(filter_of(["filter.metric=likelihood", "task.save_map=false"]).recovery, BayesRestart)
    for metric in ("proposal", "both"):
        recovery = filter_of([f"filter.metric={metric}", "task.save_map=false", "recovery.hazard=0.01"]).recovery
        assert isinstance(recovery, MetricProposal)
        assert recovery.restarts == BayesRestart(hazard=0.01)
    plain = to_plain(compose(["task=localization"]))
    on = to_plain(compose(["task=localization", "filter.metric=both"]))
    earlier = {**plain, "filter": {key: value for key, value in plain["filter"].items() if key != "metric"}}
    assert digest(earlier) == digest(plain) != digest(on)


def test_a_camera_that_is_not_known_is_told():
    config = validate(to_plain(compose(["task=localization", "filter.metric=both", "task.save_map=false"])))
    with pytest.raises(UserError, match=r"filter.metric=both: the camera of this dataset is not known"):
        check_camera(SimpleNamespace(camera=None, unit="m"), config)
