"""Recognition by COSFIRE filters from end to end: trained, resumed, tested again, on digits and on places."""

import json
import re

import numpy as np
import pytest
import torch
from data.places.place_pictures import picture
from PIL import Image
from support import evaluated, quick_config
from tiny_digits import PLAIN, arrays, digits_config, digits_run, usual_run

from sextant.chapters.cosfire.estimator import CosfireEstimator
from sextant.chapters.cosfire.task import CosfireRecognition
from sextant.cli import evaluate
from sextant.data.digits import Digits
from sextant.errors import UserError
from sextant.layers.cosfire import Blur, ConcentricCircles, Cosfire, GaborBank
from sextant.lifecycle.execute import execute
from sextant.runs.checkpoint import KEY, load_checkpoint
from sextant.runs.directory import RunDirectory

METHODS = ["cosfire_svm", "tiled_svm", "strongest_filter", "full_svm", "pooled_svm", "nearest", "network"]


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    return usual_run(tmp_path_factory)


@pytest.fixture(scope="module")
def network(tmp_path_factory):
    """A run of classification."""
    folder = tmp_path_factory.mktemp("network")
    return RunDirectory(execute(quick_config(folder, "trainer.max_epochs=1", "tracking=none")).directory)


def answers(directory):
    return {key.removeprefix("answer/"): v for key, v in arrays(directory).items() if key.startswith("answer/")}


def accuracy(directory):
    found = directory.results()["metrics"]
    return {key.removeprefix("test/accuracy/"): value for key, value in found.items() if "test/accuracy/" in key}


def weights(directory):
    return load_checkpoint(directory.last_checkpoint)["state_dict"]


def assert_equal_weights(one, other):
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)


# -- what a run finds --------------------------------------------------------------------------------------------------


def test_every_method_is_above_chance_and_filters_with_a_machine_far_above(usual):
    found = accuracy(usual)
    assert list(found) == METHODS
    assert min(found.values()) > 0.3  # of ten classes
    assert found["cosfire_svm"] > 0.8
    assert usual.results()["outcome"] == "finished"


def test_what_a_run_keeps(usual):
    found, results = arrays(usual), usual.results()
    labels = Digits().read("test").labels[::4]
    np.testing.assert_array_equal(found["labels"], labels)
    for method, share in accuracy(usual).items():
        assert share == pytest.approx((found[f"answer/{method}"] == labels).mean())
    assert results["filters"] == 20
    assert results["parts"] >= 3 * 20
    assert set(results["prices"]) == {"cosfire_svm", "tiled_svm", "full_svm", "pooled_svm"}
    assert set(results["prices"].values()) <= {1.0, 10.0}
    assert "tuning_losses" not in results
    assert [row["method"] for row in results["table"]] == sorted(METHODS, key=lambda m: -accuracy(usual)[m])
    names = {path.stem for path in usual.figures.glob("*.png")}
    assert {"prototypes", "filter_0", "response_0", "filter_9", "confusion_matrix", "errors_cosfire_svm"} <= names
    assert load_checkpoint(usual.last_checkpoint)[KEY]["task"] == "cosfire"


def test_filters_look_at_the_network_as_it_was_trained(usual):
    found = weights(usual)
    for name in ("conv1", "conv2"):
        for part in ("weight", "bias"):
            trained = found[f"network.{name}.{part}"]
            assert torch.equal(found[f"features.network.{name}.{part}"], trained)
            assert torch.equal(found[f"filters.bank.features.network.{name}.{part}"], trained)
    assert not any(name.startswith("features.network.fc") for name in found)


def test_filters_and_prototypes_are_those_of_training_images(usual):
    found = weights(usual)
    assert found["prototypes.labels"].tolist() == np.repeat(np.arange(10), 2).tolist()
    known = {image.tobytes(): label for image, label in zip(*vars(Digits().read("train")).values(), strict=True)}
    pictures = found["prototypes.pictures"].numpy()
    assert [known[image.tobytes()] for image in pictures] == found["prototypes.labels"].tolist()
    assert ((found["prototypes.points"] >= 0.15 * 27) & (found["prototypes.points"] <= 0.85 * 27)).all()
    assert (found["prototypes.own"] > 0).all()


@pytest.mark.slow
def test_own_responses_are_the_same_whether_maxima_of_examples_are_known_or_not(outputs):
    chosen = ([], ["cosfire_svm"], ["tiled_svm"])
    runs = [
        digits_run(outputs, *PLAIN, f"task.methods=[{','.join([*others, 'strongest_filter'])}]", "task.prices=[10]")
        for others in chosen
    ]
    alone, *known = (weights(run)["prototypes.own"] for run in runs)
    assert (alone > 0).all()
    assert len(alone.unique()) == 10
    for own in known:
        torch.testing.assert_close(own, alone, rtol=1e-5, atol=1e-6)


# -- identity, resuming, evaluation ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_interrupted_and_resumed_equals_uninterrupted_bit_for_bit(usual, tmp_path, monkeypatch):
    training_step, seen = CosfireRecognition.training_step, []

    def interrupted_in_the_seventh_epoch(self, batch, batch_idx):
        seen.append(self.global_step)
        if len(seen) == 6 * 13 + 5:
            raise KeyboardInterrupt
        return training_step(self, batch, batch_idx)

    monkeypatch.setattr(CosfireRecognition, "training_step", interrupted_in_the_seventh_epoch)
    with pytest.raises(KeyboardInterrupt):
        digits_run(tmp_path)
    resumed = digits_run(tmp_path)
    assert seen[6 * 13 + 5 :] == list(range(6 * 13, 8 * 13))
    assert_equal_weights(weights(usual), weights(resumed))
    assert resumed.results()["metrics"] == usual.results()["metrics"]
    for name, values in arrays(usual).items():
        np.testing.assert_array_equal(values, arrays(resumed)[name])


@pytest.mark.slow
def test_interrupted_while_filters_are_made(outputs, tmp_path, monkeypatch):
    whole = digits_run(outputs, *PLAIN, "task.prices=[10]")
    fit, done = CosfireEstimator.fit, []

    def interrupted_once(self, *examples):
        fit(self, *examples)
        if not done:
            done.append(len(self.filters))
            raise KeyboardInterrupt

    monkeypatch.setattr(CosfireEstimator, "fit", interrupted_once)
    with pytest.raises(KeyboardInterrupt):
        digits_run(tmp_path, *PLAIN, "task.prices=[10]")
    resumed = digits_run(tmp_path, *PLAIN, "task.prices=[10]")
    assert done == [10]
    assert_equal_weights(weights(whole), weights(resumed))


@pytest.mark.slow
def test_another_seed_takes_other_prototypes(usual, outputs):
    one, other = (digits_run(outputs, *PLAIN, "task.prices=[10]", f"seed={seed}") for seed in (0, 1))
    assert not torch.equal(weights(one)["prototypes.points"], weights(other)["prototypes.points"])
    assert (arrays(one)["labels"] == arrays(other)["labels"]).all()


@pytest.mark.slow
def test_a_finished_run_is_tested_again_with_the_same_answers(usual, tmp_path):
    evaluate.main([f"run={usual.path}", f"paths.outputs={tmp_path}", "tracking=none"])
    (path,) = tmp_path.glob("runs/evaluation/*/metrics.json")
    for name, values in arrays(usual).items():
        np.testing.assert_array_equal(values, arrays(RunDirectory(path.parent))[name])
    for method, found in answers(evaluated(tmp_path, usual, "task.test_every=1")).items():
        np.testing.assert_array_equal(found[::4], answers(usual)[method])


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["task.filters_per_class=3"], "belongs to the trained weights"),
        (["task.methods=[nearest]"], "belongs to the trained weights"),
        (["dataset=cifar10"], "cifar10"),
        (["dataset.size=20"], "images of 1x20x20, the filters were configured from 10 of 1x28x28"),
        (["corruption=cifar10_p"], "corruption: task=cosfire draws the corruptions of its images and cannot use"),
    ],
)
def test_what_does_not_fit_a_finished_run_is_told(usual, tmp_path, overrides, says):
    with pytest.raises(UserError, match=re.escape(says)):
        evaluate.main([f"run={usual.path}", f"paths.outputs={tmp_path}", "tracking=none", *overrides])


# -- choices -----------------------------------------------------------------------------------------------------------


def test_filters_that_look_at_images_need_no_network(outputs):
    found = digits_run(outputs, *PLAIN, "task.prices=[10]")
    assert set(accuracy(found)) == {"cosfire_svm", "tiled_svm", "strongest_filter"}
    assert accuracy(found)["cosfire_svm"] > 0.6
    assert accuracy(found)["strongest_filter"] > 0.2
    assert not any(name.startswith(("network", "features")) for name in weights(found))
    assert found.results()["metrics"]["val/accuracy"] > 0.5  # of the filters, on images that neither was made of


@pytest.mark.slow
def test_corrupted_images_are_those_of_the_suite_and_the_same_when_tested_again(outputs, tmp_path):
    under = ("corruption=cifar10_c", "corruption.names=[contrast,gaussian_noise]", "corruption.severities=[1,5]")
    found = digits_run(outputs, *PLAIN, "task.prices=[10]", "task.methods=[strongest_filter,cosfire_svm]", *under)
    clean, told = digits_run(outputs, *PLAIN, "task.prices=[10]"), found.results()
    for method in ("strongest_filter", "cosfire_svm"):  # what is fitted never sees a corrupted image
        np.testing.assert_array_equal(answers(found)[method], answers(clean)[method])
    kept, metrics = arrays(found), told["metrics"]
    right = kept["corrupted/strongest_filter/contrast/5"] == kept["labels"]
    assert metrics["test/accuracy/strongest_filter/contrast/5"] == pytest.approx(right.mean())
    assert metrics["test/headline/clean"] == pytest.approx(metrics["test/accuracy/strongest_filter"])  # the first
    each = [metrics[f"test/accuracy/strongest_filter/contrast/{severity}"] for severity in (1, 5)]
    assert metrics["test/headline/under/contrast"] == pytest.approx(np.mean(each))
    assert each[1] < each[0]
    assert [row["images"] for row in told["by_corruption"]] == ["clean", "gaussian noise", "contrast", "mean"]
    assert told["headline"] == {
        "name": "accuracy", "unit": "%", "better": "higher", "test": "clean, cifar10_c", "image_size": [28, 28]
    }  # fmt: skip
    again = evaluated(tmp_path, clean, *under).results()["metrics"]
    for name in ("test/accuracy/strongest_filter/contrast/5", "test/accuracy/cosfire_svm/gaussian_noise/1"):
        assert again[name] == metrics[name]


@pytest.mark.slow
def test_a_backbone_as_it_is_serves_filters(outputs):
    """Its weights are neither trained nor lost when the run is tested again."""
    choices = ("backbone=efficientnet_lite0", "backbone.stages=3", "features.frozen=true", "features.layer=stages")
    few = ("dataset.size=32", "inhibition=push_pull", "task.images=120", "trainer.max_epochs=1")
    found = digits_run(outputs, *choices, *few)
    assert "network" not in accuracy(found)
    assert accuracy(found)["full_svm"] > 0.6
    from sextant.models import EfficientNetLite0

    fresh = EfficientNetLite0(1, (32, 32), 2, stages=3, weights="imagenet").state_dict()
    kept = weights(found)
    torch.testing.assert_close(
        kept["features.network.stages.2.1.layers.2.0.weight"], fresh["stages.2.1.layers.2.0.weight"]
    )


@pytest.mark.slow
def test_channels_of_a_feature_map(outputs):
    choices = ("bank=channels", "strategy=channel_peaks", "trainer.max_epochs=1", "task.images=120")
    found = digits_run(outputs, *choices, "task.methods=[cosfire_svm,strongest_filter]", "task.logarithms=true")
    assert accuracy(found)["cosfire_svm"] > 0.6
    assert accuracy(found)["strongest_filter"] > 0.2


@pytest.mark.slow
def test_classes_that_the_network_never_saw_are_told_by_examples(outputs):
    few = ("task.novel_classes=3", "task.examples=5", "trainer.max_epochs=4")
    found = digits_run(outputs, *few)
    tested = Digits().read("test").labels
    np.testing.assert_array_equal(arrays(found)["labels"], tested[tested >= 7][::4])
    assert "network" not in accuracy(found)  # it has no answer
    for method, told in answers(found).items():
        assert set(told.tolist()) <= {7, 8, 9}, method
    assert accuracy(found)["cosfire_svm"] > 0.6  # of three classes
    assert set(weights(found)["prototypes.labels"].tolist()) == {7, 8, 9}
    assert weights(found)["known.labels"].bincount().tolist() == [0] * 7 + [5] * 3


@pytest.mark.slow
def test_the_network_of_another_run_stays_as_it_is(outputs, network):
    shape = ("trainer.max_epochs=1", "task.images=120")
    chosen = ("features.layer=conv2", "~backbone", "task.prices=[10]")
    found = digits_run(outputs, "features=run", f"features.run={network.path}", *chosen, *shape)
    assert set(accuracy(found)) == set(METHODS) - {"network"}
    assert accuracy(found)["cosfire_svm"] > 0.6
    trained, kept = weights(network), weights(found)
    for name in ("conv1.weight", "conv2.weight", "conv2.bias"):
        assert torch.equal(kept[f"features.network.{name}"], trained[f"network.{name}"])
    assert not any(name.startswith("network.") for name in kept)


@pytest.mark.slow
def test_a_copy_of_the_filters_is_trained_on_and_all_else_stays(usual, outputs):
    found = digits_run(outputs, "task.fine_tune.epochs=2")
    untuned, tuned = weights(usual), weights(found)
    assert set(tuned) - set(untuned) == {name for name in tuned if name.startswith("tuned")} != set()
    assert all(torch.equal(tuned[name], untuned[name]) for name in untuned)
    for method, told in answers(usual).items():
        np.testing.assert_array_equal(told, answers(found)[method])
    assert set(accuracy(found)) == {*METHODS, "cosfire_tuned", "layer_tuned"}
    assert min(accuracy(found)[method] for method in ("cosfire_tuned", "layer_tuned")) > 0.8
    losses = found.results()["tuning_losses"]
    assert [last < first for first, last in losses.values()] == [True, True]
    assert losses["cosfire_tuned"][1] < losses["layer_tuned"][1]
    assert torch.equal(tuned["tuned.rho"], tuned["filters.rho"])
    assert not torch.equal(tuned["tuned.weights"], tuned["filters.weights"])
    assert not torch.equal(tuned["tuned.channels"], tuned["filters.channels"])


@pytest.mark.slow
def test_the_number_of_tiles_changes_nothing_for_other_methods(usual, outputs):
    found = digits_run(outputs, "task.tiles=2")
    of_four, of_nine = (weights(run)["machines.tiled_svm.weights"].shape for run in (found, usual))
    assert (of_four, of_nine) == ((10, 20 * 4), (10, 20 * 9))
    told = answers(found)
    for method in set(METHODS) - {"tiled_svm"}:
        np.testing.assert_array_equal(told[method], answers(usual)[method])
    assert (told["tiled_svm"] != answers(usual)["tiled_svm"]).any()
    assert accuracy(found)["tiled_svm"] > 0.8


# -- places ------------------------------------------------------------------------------------------------------------

PLACES = (
    "experiment=cosfire_places", "features=network", "bank=gabor", "strategy=circles", "trainer.max_epochs=1",
    "dataset=place_folders", "dataset.places=order", "dataset.height=32", "dataset.width=48",
    "dataset.test={summer: summer, winter: winter, dusk: dusk}", "task.scenes.references=[summer]",
    "task.scenes.queries=[winter,dusk]", "tracking=none", "trainer.progress=false",
)  # fmt: skip


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """Blocky pictures of twelve places under three lights."""
    folder = tmp_path_factory.mktemp("street")
    for light, gain in (("summer", 1.0), ("winter", 0.8), ("dusk", 0.5)):
        (folder / light).mkdir()
        for place in range(12):
            seen = Image.fromarray((gain * picture(place, 4, 6)).astype(np.uint8)).resize(
                (48, 32), Image.Resampling.BOX
            )
            seen.save(folder / light / f"{place:02d}.png")
    return folder


def grey(path):
    return torch.from_numpy(np.array(Image.open(path).convert("L"), np.float32))[None] / 255


def places_run(street, outputs, *overrides):
    from sextant.composing.compose import compose, to_plain

    given = {override.partition("=")[0] for override in overrides}
    usual = [each for each in PLACES if each.partition("=")[0] not in given]
    paths = (f"dataset.folder={street}", f"paths.outputs={outputs}", f"paths.cache={outputs}")
    return RunDirectory(execute(to_plain(compose([*usual, *paths, *overrides]))).directory)


@pytest.mark.slow
def test_places_are_told_by_one_picture_each_without_any_network(street, outputs):
    found = places_run(street, outputs)
    kept = arrays(found)
    assert kept["labels"].tolist() == [0, 0, 1, 1, 2, 2]  # every fourth of twelve places, by two lights
    assert kept["condition/winter"].tolist() == [True, False] * 3
    told = accuracy(found)
    assert {name for name in told if "/" not in name} == {"strongest_filter", "cosfire_svm"}
    bank = GaborBank((8**0.5,), 16, phase_deg=90.0, border="replicate")
    filters = Cosfire(bank, ConcentricCircles(), blur=Blur(0.83, 0.05), t1=0.05, floor=0.1, least_weight=1.0)
    seen = {light: [grey(street / light / f"{place:02d}.png") for place in (0, 4, 8)] for light in ("summer", "winter")}
    for image in seen["summer"]:
        filters.configure(image, (23.5, 15.5))
    own, shown = (filters.maxima(torch.stack(images)) for images in seen.values())
    expected = (shown / own.diagonal()).argmax(1).tolist()
    assert kept["answer/strongest_filter"][::2].tolist() == expected
    assert told["strongest_filter/winter"] == pytest.approx(np.mean([e == k for k, e in enumerate(expected)]))
    assert told["strongest_filter"] == pytest.approx(
        (told["strongest_filter/winter"] + told["strongest_filter/dusk"]) / 2
    )
    assert found.results()["filters"] == 3


@pytest.mark.slow
def test_places_seen_through_the_network_of_another_run(street, outputs, tmp_path):
    """A classifier of pictures of that shape, of two classes."""
    for split in ("train", "test"):
        for name in ("a", "b"):
            (tmp_path / "pictures" / split / name).mkdir(parents=True)
            for k in range(6):
                Image.fromarray(picture(k, 32, 32)).save(tmp_path / "pictures" / split / name / f"{split}{k}{name}.png")
    pictures = ("dataset=image_folder", f"dataset.folder={tmp_path / 'pictures'}", "dataset.size=32")
    one = ("tracking=none", "trainer.max_epochs=1", "trainer.batch_size=8")
    run = RunDirectory(execute(quick_config(tmp_path, *pictures, *one)).directory)
    choices = (
        "features=run",
        f"features.run={run.path}",
        "features.layer=conv1",
        "bank=vectors",
        "strategy=vector_keypoints",
    )
    found = places_run(street, outputs, *choices, "descriptor=pixels", "dataset.width=32")
    told = {name for name in accuracy(found) if "/" not in name}
    assert told == {"strongest_filter", "cosfire_svm", "full_svm", "pooled_svm", "nearest", "descriptor"}
    assert accuracy(found)["nearest/winter"] == 1
    assert accuracy(found)["descriptor/winter"] == 1
    short = places_run(
        street, outputs, *choices, "descriptor=pixels", "dataset.width=32", "task.methods=[nearest_short]"
    )
    assert accuracy(short)["nearest_short/winter"] == 1


# -- mistakes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["bank=gabor"], "bank=vectors and strategy=vector_keypoints belong together"),
        (["strategy=circles"], "bank=vectors and strategy=vector_keypoints belong together"),
        (["features.frozen=true", "~backbone"], "features.frozen=true: there is no backbone"),
        (["features.frozen=true", "features.run=x"], "the network of features.run is always frozen"),
        (["descriptor=whitened_pca"], "descriptor.dimensions=128 are fitted to a map"),
        (["descriptor=network"], "descriptor.dimensions=128 are fitted to a map"),
        (["descriptor=network", "descriptor.dimensions=null"], "descriptor=network uses the backbone without training"),
        (["~backbone"], "no backbone and no features.run: the bank needs the feature map of a network"),
        (["backbone=null"], "Leave it out: '~backbone'"),
        (["task.novel_classes=1"], "Choose 0, or a number from 2 to 8"),
        (["task.novel_classes=9"], "Choose 0, or a number from 2 to 8"),
        (["features.layer=conv9"], "Choose among conv1"),
        (["features.layer=hidden1"], "not (b, c, h, w)"),
        (["task.images=5000"], "task.images=5,000: dataset=digits has 1,29"),
        (["task.images=200", "task.examples=21"], "task.examples=21: there are 20 training images of class"),
        (["features=run", "features.run=nothing"], "nothing: no run"),
        (["task.methods=[descriptor]"], "task.methods=[descriptor]: this run lacks what these need"),
        (["task.methods=[network]", "task.novel_classes=3"], "this run lacks what these need"),
        (["task.methods=[cosfire_svm,cosfire_svm]"], "task.methods"),
        (["task.methods=[cosfire]"], "cosfire_svm"),
        (["task.fine_tune.epochs=-1"], "task.fine_tune.epochs"),
        (["corruption=cifar10_p"], "corruption: task=cosfire draws the corruptions of its images and cannot use"),
        (["dataset=town_seasons"], "of places it needs task.scenes"),
        (["task.least_parts=50", "task.images=120", "trainer.max_epochs=1"], "Lower task.least_parts"),
        (
            ["task.least_parts=50", "task.images=120", "trainer.max_epochs=1", "optimizer.lr=1e-9"],
            "; the network has learnt little, its validation accuracy is",
        ),
    ],
)
def test_mistakes_are_told(tmp_path, overrides, says):
    with pytest.raises(UserError, match=re.escape(says)):
        execute(digits_config(tmp_path, *overrides))


def test_no_network_is_blamed_where_there_is_none(tmp_path):
    with pytest.raises(UserError, match="could be configured") as told:
        execute(digits_config(tmp_path, *PLAIN, "task.least_parts=5000"))
    assert "network" not in str(told.value)


def test_a_run_of_a_task_without_a_feature_map(usual, outputs):
    with pytest.raises(UserError, match="is a run of task=cosfire, which has no feature map"):
        digits_run(outputs, "features=run", f"features.run={usual.path}")


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        (["dataset=digits", "task.prices=[1.0]"], "dataset=digits has classes, not places"),
        (["task.prices=[0.1,1.0]"], "scenes leave no images for choosing one"),
        (["backbone=lenet_a", "bank=channels"], "too few images each to train a network"),
        (["bank=channels"], "no backbone and no features.run"),
        (["task.novel_classes=2"], "task.novel_classes=2: the images of scenes are set by"),
        (["task.examples=1"], "task.examples=1: the images of scenes are set by"),
        (["task.scenes.queries=[night]"], "has no night"),
    ],
)
def test_mistakes_with_places_are_told(street, tmp_path, overrides, says):
    if "dataset=digits" in overrides:
        from sextant.composing.compose import compose, to_plain

        kept = [each for each in PLACES if not each.startswith("dataset")]
        with pytest.raises(UserError, match=re.escape(says)):
            execute(to_plain(compose([*kept, *overrides, f"paths.outputs={tmp_path}"])))
        return
    with pytest.raises(UserError, match=re.escape(says)):
        places_run(street, tmp_path, *overrides)


@pytest.mark.slow
def test_a_checkpoint_cannot_smuggle_in_a_part_of_the_network_of_another_run(outputs, network, tmp_path):
    """The config of that run is kept as well, and built from."""
    shape = ("trainer.max_epochs=1", "task.images=120", "task.filters_per_class=1", "task.methods=[strongest_filter]")
    found = digits_run(
        outputs, "features=run", f"features.run={network.path}", "features.layer=conv2", "~backbone", *shape
    )
    content = load_checkpoint(found.last_checkpoint)
    content[KEY]["spec"]["features"]["config"]["backbone"] = {"_target_": "os.system", "command": "false"}
    torch.save(content, altered := tmp_path / "altered.ckpt")
    with pytest.raises(UserError, match=re.escape("import paths outside Sextant: os.system")):
        evaluate.main([f"run={altered}", f"paths.outputs={tmp_path}", "tracking=none"])


def test_the_history_tells_of_every_epoch(usual):
    lines = [json.loads(line)["metrics"] for line in usual.history.read_text().splitlines()]
    assert sum("train/loss" in line for line in lines) >= 8
