"""Place recognition end to end on folders of small pictures in two lights."""

import json
import sys

import numpy as np
import pytest
import torch
import yaml
from PIL import Image
from scipy.ndimage import gaussian_filter
from support import evaluated
from tiny_places import place_words

from sextant.chapters.places.chapter import PlacesChapter
from sextant.chapters.places.data import PlaceTolerance
from sextant.chapters.places.whitening import Whitening, solve_projection
from sextant.cli import evaluate
from sextant.composing.compose import compose, to_plain
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.kit.trained import model_from_checkpoint, read_trained
from sextant.lifecycle.evaluation import evaluate_run
from sextant.lifecycle.execute import execute
from sextant.runs.directory import RunDirectory

PLACES = {"train": 48, "val": 16, "test": 24}


def scene(number, night):
    """A smooth picture of one place; at night its negative, darker, with noise of its own."""
    rng = np.random.default_rng(number)
    picture = gaussian_filter(rng.normal(size=(16, 24, 3)), (1.5, 1.5, 0))
    picture = 128 + 90 * picture / np.abs(picture).max()
    if night:
        picture = 80 - 0.3 * picture + np.random.default_rng(number + 10_000).normal(scale=4, size=picture.shape)
    return Image.fromarray(picture.clip(0, 255).astype(np.uint8))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("places")
    number = 0
    for split, count in PLACES.items():
        for k in range(count):
            for light in ("day", "night"):
                path = root / split / light / f"{k:03d}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                scene(number + k, light == "night").save(path)
        number += 1000
    return root


def config(folder, outputs, *overrides):
    chosen = (
        "backbone=place_cnn",
        "task.whitening=null",  # there are fewer images than numbers in a descriptor
        "task.batch_places=12",
        "trainer.max_epochs=8",
    )
    return to_plain(compose(place_words(folder, outputs, *chosen, *overrides)))


@pytest.fixture(scope="module")
def trained(folder, tmp_path_factory):
    outputs = tmp_path_factory.mktemp("outputs")
    return outputs, RunDirectory(execute(config(folder, outputs)).directory)


def test_it_learns_to_find_places_again_at_night(trained):
    _, run = trained
    results = run.results()
    assert results["outcome"] == "finished"
    metrics = results["metrics"]
    assert metrics["test/recall_at_1"] > 5 * metrics["test/chance"]
    assert metrics["test/chance"] == pytest.approx(1 / PLACES["test"])
    assert metrics["test/R_at_1_pm0f_night_to_day"] == pytest.approx(metrics["test/recall_at_1"])
    assert metrics["test/place_nll_pm0f_night_to_day"] < metrics["test/place_nll_uniform_pm0f_night_to_day"]
    with np.load(run.arrays) as arrays:
        assert arrays["R@1_pm0f_night_to_day/network"].mean() == pytest.approx(metrics["test/recall_at_1"])
        assert arrays["R@1_pm0f_night_to_day/network"].mean() > arrays["R@1_pm0f_night_to_day/untrained network"].mean()


def test_methods_that_cannot_learn_from_so_few_images_are_named(trained):
    _, run = trained
    methods = {row["method"] for row in run.results()["table"]}
    assert {"pixels", "HOG", "untrained network", "network"} <= methods
    assert set(run.results()["baselines_left_out"]["night"]) == {"LDA", "CCA"}


@pytest.mark.slow
def test_recall_with_and_without_re_ranking_is_measured_in_one_test(trained, folder):
    outputs, run = trained
    for package in ("kornia", "poselib"):
        pytest.importorskip(package)
    tested = evaluated(outputs, run, "task.rerank=4", "local=trunk", "local.side=96", "task.baselines=false")
    results = tested.results()
    metrics, facts = results["metrics"], results["reranked"]
    name = "R@1_reranked_pm0f_night_to_day"
    assert metrics["test/R_at_1_pm0f_night_to_day"] == run.results()["metrics"]["test/R_at_1_pm0f_night_to_day"]
    with np.load(tested.arrays) as arrays:
        before, after = arrays["R@1_pm0f_night_to_day/network"], arrays[f"{name}/network"]
    assert metrics["test/R_at_1_reranked_pm0f_night_to_day"] == after.mean()
    assert facts["candidates"] == 4
    assert facts["local"].startswith("trunk 2048 96")
    assert facts["bytes_per_image"] > 0
    assert (before != after).sum() <= facts["replaced"] <= len(after)
    assert results["table"][0]["R@1 re-ranked"] == f"{100 * after.mean():.1f}"


def test_re_ranking_changes_the_digest_only_if_it_is_asked_for(folder, tmp_path):
    plain = config(folder, tmp_path)
    digests = [digest(validate(each).model_dump(by_alias=True)) for each in (
        plain,
        {key: value for key, value in plain.items() if key != "local"}
        | {"task": {key: value for key, value in plain["task"].items() if key != "rerank"}},
        config(folder, tmp_path, "task.rerank=4"),
        config(folder, tmp_path, "task.rerank=4", "local=xfeat", "local.side=320"),
    )]  # fmt: skip
    assert digests[0] == digests[1]
    assert len(set(digests)) == 3
    for words in (["task.rerank=0"], ["local=xfeat", "local.side=10"]):
        with pytest.raises(UserError, match=words[-1].split("=")[0]):
            validate(config(folder, tmp_path, *words))


@pytest.mark.parametrize(("words", "told"), [
    (["local=none"], r"local=none: task\.rerank=4 needs local features"),
    (["dataset=town_factors"], r"task\.rerank=4: matches of dataset=town_factors are not re-ranked"),
    (["local=trunk", "local.layers=[gone]"], r"local\.layers=\['gone'\] are not in the network\nChoose among backbone"),
])  # fmt: skip
def test_what_cannot_be_re_ranked_is_told_before_the_test(folder, tmp_path, trained, words, told):
    if words[0] == "dataset=town_factors":
        with pytest.raises(UserError, match=told):
            PlacesChapter().source(validate(to_plain(compose(["task=place_recognition", "task.rerank=4", *words]))))
        return
    outputs, run = trained
    with pytest.raises(UserError, match=told):
        evaluate_run(str(run.path), [f"paths.outputs={outputs}", "task.rerank=4", *words])


def test_a_missing_package_is_told_before_the_test(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "kornia", None)
    with pytest.raises(UserError, match="local features need kornia"):
        PlacesChapter().source(validate(config(folder, tmp_path, "task.rerank=4")))


def test_pictures(trained):
    _, run = trained
    names = {path.stem for path in run.figures.glob("*.png")}
    assert names == {"precision_recall_night", "similarity_night", "gallery_night", "condition_confusion"}


@pytest.mark.slow
def test_the_last_layer_is_solved_for_after_the_last_epoch(folder, tmp_path):
    whitening = ["task.whitening={components: 64, shrinkage: 1.0}", "task.dimension=16", "task.baselines=false"]
    run = RunDirectory(execute(config(folder, tmp_path, *whitening)).directory)
    raw = yaml.safe_load(run.config.read_text())
    module = model_from_checkpoint(validate(raw), read_trained(run.last_checkpoint), run.last_checkpoint)
    kept = module.network.projection.weight.clone()
    torch.nn.init.zeros_(module.network.projection.weight)
    train = PlacesChapter().source(validate(raw)).read("train")
    solve_projection(module.network, train, PlaceTolerance("frames", 0, 1), Whitening(64, 1.0))
    torch.testing.assert_close(module.network.projection.weight, kept, rtol=1e-3, atol=1e-4)


def test_too_few_images_to_solve_for_the_last_layer_are_told_before_training(folder, tmp_path):
    with pytest.raises(UserError, match=r"task.whitening: 96 training images.*\n.*task.dimension=95"):
        execute(config(folder, tmp_path, "task.whitening={components: 256, shrinkage: 1.0}"))
    with pytest.raises(UserError, match=r"components=8 must be at least task.dimension=16"):
        execute(config(folder, tmp_path, "task.whitening={components: 8, shrinkage: 1.0}", "task.dimension=16"))
    few = ["task.whitening={components: 40, shrinkage: 1.0}", "task.dimension=40", "pooling=average"]
    with pytest.raises(UserError, match=r"the pooling gives 32 numbers.*\n.*task.dimension=32"):
        execute(config(folder, tmp_path, *few, "backbone.widths=[8, 8, 8, 32]"))
    ten = "task.whitening={components: 32, shrinkage: 1, images: 10}"
    with pytest.raises(UserError, match=r"task.whitening.images=10 leaves 10; for task.dimension=16 .*\n.*images=96"):
        execute(config(folder, tmp_path, ten, "task.dimension=16"))
    with pytest.raises(UserError, match=r"test_checkpoint=best needs task.whitening=null"):
        execute(config(folder, tmp_path, "task.whitening={components: 8, shrinkage: 1}", "task.test_checkpoint=best"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        ["loss=triplet_ratio", "mining=batch_hard", "task.normalise=false"],
        ["loss=triplet_margin", "mining=cached_hard", "mining.anchors=20", "mining.candidates=20"],
        ["loss=multi_similarity", "pooling=netvlad", "pooling.clusters=4"],
        ["loss=contrastive", "pooling=gem", "inhibition=push_pull"],
        ["loss=soft_margin", "mining=semi_hard", "pooling=mixvpr", "pooling.out_channels=8"],
    ],
)
def test_choices_can_be_combined(folder, tmp_path, overrides):
    quick = ("trainer.max_epochs=1", "task.baselines=false")  # which know nothing of these choices
    run = RunDirectory(execute(config(folder, tmp_path, *quick, *overrides)).directory)
    assert np.isfinite(run.results()["metrics"]["test/recall_at_1"])


@pytest.mark.slow
def test_evaluation_repeats_the_test(trained, folder):
    outputs, run = trained
    evaluate.main([f"run={run.path}", "task.baselines=false", f"paths.outputs={outputs}", "tracking=none"])
    newest = max(outputs.glob("runs/evaluation/*/metrics.json"), key=lambda path: path.stat().st_mtime_ns)
    again = json.loads(newest.read_text())["metrics"]
    assert again["test/recall_at_1"] == run.results()["metrics"]["test/recall_at_1"]


@pytest.mark.slow
def test_a_trained_run_is_tested_in_bad_pictures(trained):
    """Beside the clean recall, which is as it was; pairs of conditions are of clean images alone."""
    outputs, run = trained
    suite = ["corruption=cifar10_c", "corruption.names=[gaussian_noise,contrast]", "corruption.severities=[5]"]
    tested = evaluated(outputs, run, "task.baselines=false", *suite)
    metrics, clean = tested.results()["metrics"], run.results()["metrics"]
    for name in ("test/recall_at_1", "test/R_at_1_pm0f_night_to_day", "test/R_at_1_across_pm0f"):
        assert metrics[name] == clean[name], name
    assert metrics["test/R_at_1_pm0f_night_corrupted_to_day"] < clean["test/recall_at_1"]
    assert not any("to_night_corrupted" in name for name in metrics)


@pytest.mark.slow
def test_runs_repeat_bit_for_bit(folder, tmp_path):
    first, second = (
        execute(config(folder, tmp_path / name, "trainer.max_epochs=2", "task.baselines=false")) for name in "ab"
    )
    weights = [
        torch.load(RunDirectory(each.directory).last_checkpoint, weights_only=True)["state_dict"]
        for each in (first, second)
    ]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["loss=bearing"], "is not one of task=place_recognition"),
        (["corruption=cifar10_p"], "corruption=none"),
        (["task.tolerance.m.negative=1"], "positive=3 must be below negative=1"),
        (["task.train_conditions=[day]", "task.test_conditions=[night]"], "nothing to learn from"),
    ],
)
def test_mistakes(folder, tmp_path, overrides, said):
    with pytest.raises(UserError, match=said):
        execute(config(folder, tmp_path, *overrides))


def test_a_dataset_without_places(tmp_path):
    raw = to_plain(compose(["task=place_recognition", "dataset=digits", f"paths.outputs={tmp_path}", "tracking=none"]))
    with pytest.raises(UserError, match=r"has no places.*\n.*town_seasons"):
        execute(raw)
