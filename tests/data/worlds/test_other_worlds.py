"""Another number of a world is another world, as sound as the usual one; what is fitted elsewhere stays there."""

from functools import cache

import numpy as np
import pytest
from quick_runs import quick_runs  # noqa: F401
from tiny_office import office_cache, office_config

from sextant.chapters.calibration.data.panoramas import as_panorama_source, rendered_sources
from sextant.chapters.localization.data.fitted_elsewhere import FittedElsewhere
from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.kit.assemble import build_dataset
from sextant.lifecycle.execute import execute
from sextant.registry import chapter_of

DATASETS = ("office_walk", "town_seasons", "town_city", "town_panoramas", "town_factors", "cold")
#: worlds that are laid out, of which the suite without its slow tests takes two
WORLDS = {"office_walk": range(1, 9), "town_seasons": range(1, 9), "town_city": range(1, 4)}
QUICK = (("office_walk", 3), ("town_seasons", 5))


def plain(*overrides):
    return validate(to_plain(compose(list(overrides)))).model_dump(by_alias=True)


def plan_of(*overrides):
    return build_dataset(validate(to_plain(compose(list(overrides))))).plan()


@cache
def usual_plan(name):
    return plan_of(f"dataset={name}", "dataset.world=0")


@pytest.mark.parametrize(
    ("name", "world"),
    [
        pytest.param(name, world, marks=[] if (name, world) in QUICK else pytest.mark.slow)
        for name, worlds in WORLDS.items()
        for world in worlds
    ],
)
def test_another_world_is_laid_out_soundly(name, world):
    plan, usual = plan_of(f"dataset={name}", f"dataset.world={world}"), usual_plan(name)
    shots = plan.shots
    assert plan.digest != usual.digest
    assert len(shots) > 0.95 * len(usual.shots)  # the drives are there, and as long
    assert not np.array_equal(shots.pose[:500], usual.shots.pose[:500])
    for split in np.unique(shots.split):
        drive = shots.pose[(shots.split == split) & (shots.condition == 0), :2]
        if name != "town_city" or split:  # whose map goes along all streets
            assert np.linalg.norm(np.diff(drive, axis=0), axis=1).max() < (4.0 if name != "office_walk" else 90.0)
    if name == "office_walk":
        plan.office.plan.check_poses(shots.pose, clearance_m=0.2)
        return
    for scene in np.unique(shots.scene):
        graph = plan.graph(scene)
        assert np.bincount(graph.edges.ravel(), minlength=len(graph.nodes)).min() >= 2  # no dead ends


@pytest.mark.slow
@pytest.mark.parametrize(("name", "world"), [("office_walk", 4), ("town_seasons", 4)])
def test_another_world_renders(name, world):
    plan = plan_of(f"dataset={name}", f"dataset.world={world}", "dataset.width=48", "dataset.height=32")
    first, usual = (each.render(100, 102)["images"] for each in (plan, plan_of(f"dataset={name}", "dataset.width=48",
                                                                            "dataset.height=32")))  # fmt: skip
    assert first.std() > 10  # it shows something
    assert np.abs(first.astype(float) - usual).mean() > 5  # and something else


@pytest.mark.parametrize("name", DATASETS)
def test_without_a_number_the_world_and_the_digest_are_those_of_before(name):
    node = plain(f"dataset={name}")["dataset"]
    assert not {"world", "fit_world"} & set(node)
    if name != "cold":
        usual = plan_of(f"dataset={name}")
        assert usual.digest == plan_of(f"dataset={name}", "dataset.world=0").digest
        assert "world" not in usual.config
        assert (
            plan_of(f"dataset={name}", "dataset.world=2").digest == plan_of(f"dataset={name}", "dataset.seed=2").digest
        )
    number = "dataset.world=1"
    assert digest(plain(f"dataset={name}", number)) != digest(plain(f"dataset={name}"))


def test_a_town_within_a_mix_is_another_one_too():
    folder = "dataset.sources.real.folder=photos"
    usual, other = (
        build_dataset(validate(to_plain(compose(["task=calibration", "dataset=panorama_mix", folder, *more]))))
        for more in ([], ["dataset.sources.town.world=3"])
    )
    towns = [world for mix in (usual, other) for world in rendered_sources(as_panorama_source(mix))]
    assert [world.dataset.plan().config["seed"] for world in towns] == [0, 3]
    assert towns[0].fingerprint() != towns[1].fingerprint()


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["dataset=office_walk", "dataset.world=-1"], "dataset.world=-1"),
        (["dataset=office_walk", "dataset.world=1.5"], "dataset.world"),
        (
            ["dataset=office_walk", "dataset.world=3", "dataset.seed=2"],
            "dataset.world=3 and dataset.seed=2 name two worlds",
        ),
        (["dataset=office_walk", "dataset.fit_world=0"], "dataset.fit_world=0 is the tested world"),
        (["dataset=town_city", "dataset.world=2", "dataset.fit_world=2"], "dataset.fit_world=2 is the tested world"),
        (["dataset=town_seasons", "dataset.seed=2", "dataset.fit_world=2"], "dataset.fit_world=2 is the tested world"),
        (["dataset=town_panoramas", "dataset.world=3", "dataset.seed=1"], "name two worlds"),
    ],
)
def test_a_world_that_cannot_be_is_refused(overrides, said):
    with pytest.raises(UserError) as caught:
        plain(*overrides)
    assert said in str(caught.value)


def test_a_task_without_fits_elsewhere_refuses_them():
    overrides = ["task=place_recognition", "dataset.world=1", "dataset.fit_world=0"]
    with pytest.raises(UserError, match=r"dataset.fit_world=0: task=place_recognition trains on separate towns"):
        build_dataset(validate(to_plain(compose(overrides))))


@pytest.mark.slow
def test_everything_is_fitted_in_the_other_world(tmp_path):
    """The tested world lends its map and its test drives; a run of the life cycle gives finite results."""
    raw = office_config(office_cache(), tmp_path, "dataset.world=1", "dataset.fit_world=0")
    config = validate(raw)
    chapter = chapter_of("localization")
    source = chapter.source(config)
    assert isinstance(source, FittedElsewhere)
    found, tested, fitted = source.read(), source.tested.read(), source.fitted.read()
    assert np.array_equal(found.map.poses, tested.map.poses)
    assert [drive.name for drive in found.test] == [drive.name for drive in tested.test]
    assert np.array_equal(found.fitted.poses, fitted.map.poses)
    assert np.array_equal(found.validation_map.poses, fitted.map.poses)
    assert [drive.name for drive in found.validation] == [f"world0/{drive.name}" for drive in fitted.validation]
    assert source.fingerprint() not in (source.tested.fingerprint(), source.fitted.fingerprint())
    data = chapter.data(config, source)
    assert data.choices(0)[0].max() == min(len(fitted.map), 10**6) - 1  # rows of the map that is fitted to
    alone, other = data.descriptors(found.map), data.descriptors(found.fitted)
    assert alone.shape[1] == other.shape[1]
    assert not np.array_equal(alone[:50], other[:50])
    assert 0 <= execute(raw).metrics["test/success"] <= 1
