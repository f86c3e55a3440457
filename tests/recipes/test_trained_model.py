"""Published networks are tested and used as if they were runs."""

import subprocess
import sys

import numpy as np
import pytest
import torch
from evaluation.classification.published_results import read_corruption_details
from PIL import Image
from support import as_published

from sextant.atomic_files import write_json
from sextant.cli import evaluate
from sextant.cli.show import show_result, show_start
from sextant.corruptions import BenchmarkSuite
from sextant.data.cifar10 import CIFAR10
from sextant.errors import UserError
from sextant.kit.trained import model_from_checkpoint, read_trained
from sextant.lifecycle.evaluation import checkpoint_config
from sextant.lifecycle.execute import Outcome
from sextant.lifecycle.published_figures import same_images
from sextant.models import DenseNetCifar, ResNetCifar, load_published
from sextant.runs.checkpoint import KEY
from sextant.runs.directory import RunDirectory


def a_resnet(depth=20):
    return ResNetCifar(3, (32, 32), 10, depth=depth)


def a_densenet():
    return DenseNetCifar(3, (32, 32), 10, depth=10, growth=3)


@pytest.mark.parametrize(
    ("network", "first"),
    [
        (a_resnet(), "conv1"),
        (a_resnet(32), None),
        (DenseNetCifar(3, (32, 32), 10, depth=10, growth=3), "features.conv0"),
    ],
)
def test_a_published_network_is_built_from_its_config(tmp_path, network, first):
    path = as_published(network, tmp_path / "checkpoint.pth.tar", push_pull=(first,) if first else ())
    content = read_trained(path)
    config = checkpoint_config(content[KEY], ["dataset.train_batches=1"])
    model = model_from_checkpoint(config, content, path)
    images = torch.rand(2, 3, 32, 32)
    with torch.no_grad():
        assert torch.equal(model(images), load_published(path).network(images))


def test_inhibition_elsewhere_is_refused(tmp_path):
    path = as_published(a_resnet(), tmp_path / "checkpoint.pth.tar", push_pull=("conv1", "layer1.0.conv1"))
    with pytest.raises(UserError, match=r"push-pull layers at conv1, layer1\.0\.conv1"):
        read_trained(path)


def shown(capsys, published, accuracy, tmp_path, **changes):
    """What is printed before and after the test of a network that was not trained here."""
    config = checkpoint_config(published[KEY], [f"paths.outputs={tmp_path}"])
    directory = RunDirectory(tmp_path)
    show_start(config, directory, (), published[KEY]["published"])
    told = published[KEY]["published"] | {"same_images": same_images(config)} | changes
    results = {"metrics": {"test/accuracy/clean": accuracy}, "outcome": "finished", "parameters": 3}
    write_json(directory.metrics, results | {"published": told, "timing": {"fit_s": 0.0, "test_s": 1.0}})
    show_result(Outcome("finished", directory.path))
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("name", "accuracy", "changes", "says"),
    [
        ("model_best.pth.tar", 0.9171, {}, "accuracy equals best_prec1 of model_best.pth.tar, 91.71 %"),
        (
            "model_best.pth.tar",
            0.9170,
            {},
            "0.01 points below best_prec1 of model_best.pth.tar, 91.71 %: it is NOT",
        ),
        ("checkpoint.pth.tar", 0.9171, {}, "equals best_prec1 of checkpoint.pth.tar, 91.71 %"),
        (
            "checkpoint.pth.tar",
            0.9162,
            {},
            "0.09 points below best_prec1 of checkpoint.pth.tar, 91.71 %, which is",
        ),
        (
            "checkpoint.pth.tar",
            0.9200,
            {},
            "0.29 points above best_prec1 of checkpoint.pth.tar, 91.71 %: it is NOT",
        ),
        (
            "model_best.pth.tar",
            0.9170,
            {"precision": "bf16-mixed"},
            "0.01 points below best_prec1 of model_best.pth.tar, 91.71 %, as computed in bf16-mixed; the file's was",
        ),
        ("model_best.pth.tar", 0.9171, {"same_images": False}, "not compared with best_prec1 of model_best.pth.tar"),
    ],
)
def test_what_the_file_of_a_published_network_says_is_told(tmp_path, capsys, name, accuracy, changes, says):
    path = as_published(a_densenet(), tmp_path / name, best_prec1=torch.tensor(91.71), epoch=161)
    told = shown(capsys, read_trained(path), accuracy, tmp_path, **changes)
    assert f"{name} says: saved after epoch 161, best_prec1 91.71 %" in told
    assert says in told
    for of_a_run_that_never_was in ("epochs of batches", "SGD", "trained in"):
        assert of_a_run_that_never_was not in told


@pytest.mark.real_data
@pytest.mark.slow
def test_the_recorded_accuracy_of_a_published_network_is_found_again(real_data, tmp_path, capsys):
    path = real_data / "pushpull_cifar" / "models" / "resnet-cifar" / "resnet-20-pp" / "model_best.pth.tar"
    small = "trainer.eval_batch_size=50"  # whose maps stay in the caches
    evaluate.main([f"run={path}", "corruption=none", "tracking=none", small, f"paths.outputs={tmp_path}"])
    told = " ".join(capsys.readouterr().out.split())
    assert "saved after epoch 161, best_prec1 91.71 %" in told
    assert "accuracy equals best_prec1 of model_best.pth.tar, 91.71 %" in told


PROBE = """
import sys, torch
from sextant.cli import predict
loads, load = [], torch.load
torch.load = lambda *given, **more: loads.append(given) or load(*given, **more)
predict.main(sys.argv[1:])
print("read", len(loads), [name for name in ("pytorch_lightning", "mlflow", "torchvision") if name in sys.modules])
"""


@pytest.mark.slow
def test_one_image_is_classified_without_lightning_and_its_network_read_once(tmp_path):
    path, image = as_published(a_densenet(), tmp_path / "checkpoint.pth.tar"), tmp_path / "one.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (32, 32, 3), np.uint8)).save(image)
    arguments = [f"run={path}", f"input={image}", f"output={tmp_path / 'out'}"]
    done = subprocess.run(
        [sys.executable, "-c", PROBE, *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stderr == ""
    assert "1 image classified" in done.stdout
    assert done.stdout.endswith("read 1 []\n")


@pytest.mark.real_data
@pytest.mark.slow
def test_errors_under_corruptions_made_here_are_those_published(real_data):
    """The first 1000 of 10,000 images at severity 3: 1.5 points is one standard error of one corruption's.

    The published errors are of the last epoch, the networks here of the best: a few epochs apart, at one learning rate.
    """
    folder, name = real_data / "pushpull_cifar", "resnet-20-pp"
    network = load_published(folder / "models" / "resnet-cifar" / name / "model_best.pth.tar").network
    published = read_corruption_details(folder / "results" / "resnet" / name / "C_details.txt", 0).severities
    data = CIFAR10([real_data]).read("test")
    images, labels = torch.from_numpy(data.images[:1000]).float() / 255, torch.from_numpy(data.labels[:1000])
    suite = BenchmarkSuite(severities=[3])
    differences = {}
    with torch.inference_mode():
        for condition in suite.conditions()[1:]:
            corrupted = suite.corrupt(images, torch.arange(1000), condition).split(20)
            chosen = torch.cat([network(batch).argmax(1) for batch in corrupted])
            error = (chosen != labels).double().mean().item()
            differences[condition.corruption] = error - published[condition.corruption][2]
    frost = differences.pop("frost")  # textures of our own
    assert abs(sum(differences.values()) / len(differences)) < 0.015
    assert max(map(abs, differences.values())) < 0.045
    assert abs(frost) < 0.08
