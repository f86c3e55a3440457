"""Classifiers of others are tested in one line; the files are of random weights."""

import json

import numpy as np
import pytest
import torch
from PIL import Image
from quick_runs import quick_runs  # noqa: F401
from safetensors.torch import save_file

from sextant.cli import evaluate
from sextant.errors import UserError
from sextant.layers import PushPullInhibition
from sextant.models import robustbench_net


@pytest.fixture
def folder(tmp_path):
    """Two classes of 24 images for training and 6 for test, of 40x32 pixels."""
    rng = np.random.default_rng(0)
    for number in range(60):
        path = tmp_path / "in" / ("train" if number % 5 else "test") / f"{number % 2}"
        path.mkdir(parents=True, exist_ok=True)
        small = Image.fromarray(rng.integers(0, 256, (8, 10, 3), np.uint8))
        small.resize((40, 32), Image.Resampling.BICUBIC).save(path / f"{number}.png")
    return tmp_path / "in"


@pytest.fixture
def standard(tmp_path):
    torch.manual_seed(0)
    network = robustbench_net(3, (32, 32), 2, depth=10, width=1, mean=[0.0] * 3, std=[1.0] * 3).eval()
    torch.save(network.state_dict(), tmp_path / "Standard.pt")
    return network, f"model=robustbench:{tmp_path / 'Standard.pt'}"


def run(tmp_path, *arguments):
    known = set(tmp_path.glob("out/runs/evaluation/*/metrics.json"))
    evaluate.main([*arguments, f"paths.outputs={tmp_path / 'out'}", "tracking=none"])
    (new,) = set(tmp_path.glob("out/runs/evaluation/*/metrics.json")) - known
    return json.loads(new.read_text()), np.load(new.with_name("predictions.npz"))


@pytest.mark.slow
def test_a_robustbench_file_with_and_without_push_pull(tmp_path, folder, standard, capsys):
    network, model = standard
    data = ["dataset=image_folder", f"dataset.folder={folder}", "dataset.size=32"]
    suite = ["corruption=cifar10_c", "corruption.names=[fog,contrast]"]
    results, arrays = run(tmp_path, model, *data, *suite)
    from sextant.data.image_folder import ImageFolder

    images = torch.from_numpy(ImageFolder(str(folder), size=32).read("test").images).float() / 255
    with torch.no_grad():
        expected = network(images).softmax(1)
        inhibited = PushPullInhibition()(network)(images).softmax(1)
    np.testing.assert_allclose(arrays["confidence/clean"], expected.amax(1), rtol=1e-5)
    rows = {row["corruption"]: row for row in results["table"]}
    assert list(rows) == ["clean", "fog", "contrast", "mean"]
    metrics = results["metrics"]
    assert rows["mean"]["CE %"] == f"{100 * metrics['test/mce']:.1f}"
    assert rows["mean"]["relative CE %"] == f"{100 * metrics['test/relative_mce']:.1f}"
    for title, name, digits in (("ECE", "ece", 4), ("NLL", "nll", 3)):
        fog = np.mean([metrics[f"test/{name}/fog/{level}"] for level in range(1, 6)])
        contrast = np.mean([metrics[f"test/{name}/contrast/{level}"] for level in range(1, 6)])
        assert rows["fog"][title] == f"{fog:.{digits}f}"
        assert float(rows["mean"][title]) == pytest.approx((fog + contrast) / 2, abs=10**-digits)
    assert results["foreign"]["sha256"][:12] in results["foreign"]["card"]
    assert "not of Sextant" in " ".join(capsys.readouterr().out.split())
    _, arrays = run(tmp_path, model, *data, "inhibition=push_pull")
    np.testing.assert_allclose(arrays["confidence/clean"], inhibited.amax(1), rtol=1e-4)


@pytest.mark.slow
def test_a_timm_file_brings_its_size_crop_and_standardisation(tmp_path, folder):
    timm = pytest.importorskip("timm")
    torch.manual_seed(0)
    network = timm.create_model("mobilenetv3_small_050", num_classes=2).eval()
    save_file(network.state_dict(), tmp_path / "mobilenetv3_small_050.safetensors")
    model = f"model=timm:{tmp_path / 'mobilenetv3_small_050.safetensors'}"
    _, arrays = run(tmp_path, model, "dataset=image_folder", f"dataset.folder={folder}")
    config = timm.data.resolve_data_config({}, model=network)
    transform = timm.data.create_transform(**config)
    paths = sorted((folder / "test").glob("*/*.png"), key=lambda path: (path.parent.name, str(path)))
    with torch.no_grad():
        theirs = network(torch.stack([transform(Image.open(path)) for path in paths])).softmax(1)
    # theirs is scaled to whole pixels before it is cropped, ours by the crop itself
    np.testing.assert_allclose(arrays["confidence/clean"], theirs.amax(1), atol=0.02)


def told(tmp_path, *arguments):
    with pytest.raises(UserError) as error:
        evaluate.main([*arguments, f"paths.outputs={tmp_path / 'out'}", "tracking=none"])
    return str(error.value)


def test_mistakes(tmp_path, folder, standard):
    _, model = standard
    data = ["dataset=image_folder", f"dataset.folder={folder}"]
    for arguments, said in (
        ([model], "dataset= is missing"),
        ([model, "run=x", *data], "model= must be given once and without run="),
        ([model, *data, "backbone=resnet20"], "backbone=resnet20: this cannot be chosen for model="),
        ([model, *data, "inhibitoin=push_pull"], "Did you mean inhibition?"),
        ([model, *data, "corruption=nope"], "cifar100_c"),
        ([model, "dataset=digits"], "takes 3"),
        ([model, "dataset=cifar100"], "dataset=cifar100 has 100 classes"),
        ([model, *data, "dataset.size=12", "backbone.std=[0,1,1]"], "backbone.std.0=0.0"),
        (["model=timm:nothing_like_it", *data], "there is no such network or file"),
    ):
        assert said in told(tmp_path, *arguments), arguments
    (tmp_path / "Standard.pt").rename(tmp_path / "mine.pt")
    assert "backbone.mean= is missing" in told(tmp_path, model.replace("Standard", "mine"), *data)
