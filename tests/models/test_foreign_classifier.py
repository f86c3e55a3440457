"""Files in the published layouts, of random weights: no weights of others are used here."""

import json

import pytest
import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from torchvision.models import resnet18
from torchvision.models.resnet import Bottleneck

from sextant.errors import UserError
from sextant.models import TimmClassifier, robustbench_net
from sextant.models.foreign_classifier import read_foreign


def drawn(network):
    """The network with random statistics of normalisation too, so that a wrong order of layers shows."""
    generator = torch.Generator().manual_seed(0)
    for name, value in network.state_dict().items():
        if value.is_floating_point():
            noise = torch.rand(value.shape, generator=generator)
            value.copy_(noise + 0.5 if "bn" in name or "running" in name or value.ndim == 1 else (noise - 0.5) / 4)
    return network.eval()


def of_bn(name, channels):
    return {f"{name}.{part}": (channels,) for part in ("weight", "bias", "running_mean", "running_var")} | {
        f"{name}.num_batches_tracked": ()
    }


def published_wrn(depth, factor, classes):
    """Names and shapes of RobustBench's WideResNet, from its source."""
    widths, found = [16, 16 * factor, 32 * factor, 64 * factor], {"conv1.weight": (16, 3, 3, 3)}
    for block in (1, 2, 3):
        for layer in range((depth - 4) // 6):
            before, width, at = widths[block - 1 if layer == 0 else block], widths[block], f"block{block}.layer.{layer}"
            found |= of_bn(f"{at}.bn1", before) | of_bn(f"{at}.bn2", width)
            found |= {f"{at}.conv1.weight": (width, before, 3, 3), f"{at}.conv2.weight": (width, width, 3, 3)}
            if layer == 0:
                found[f"{at}.convShortcut.weight"] = (width, before, 1, 1)
    return found | of_bn("bn1", widths[-1]) | {"fc.weight": (classes, widths[-1]), "fc.bias": (classes,)}


@pytest.mark.parametrize(("depth", "factor", "classes"), [(28, 10, 10), (40, 2, 100)])
def test_a_wide_resnet_has_the_published_names_and_shapes(depth, factor, classes):
    network = robustbench_net(3, (32, 32), classes, depth=depth, width=factor)
    assert {name: tuple(v.shape) for name, v in network.state_dict().items()} == published_wrn(depth, factor, classes)


def test_a_wide_resnet_computes_what_the_paper_draws():
    network = drawn(robustbench_net(3, (16, 16), 5, depth=10, width=2, mean=[0.5] * 3, std=[0.25] * 3))
    state = network.state_dict()

    def normed(x, name):
        means, variances, weight, bias = (
            state[f"{name}.{part}"] for part in ("running_mean", "running_var", "weight", "bias")
        )
        return F.relu(F.batch_norm(x, means, variances, weight, bias))

    images = torch.rand(2, 3, 16, 16, generator=torch.Generator().manual_seed(1))
    x = F.conv2d((images - 0.5) / 0.25, state["conv1.weight"], padding=1)
    for block in (1, 2, 3):
        at, stride = f"block{block}.layer.0", min(block, 2)
        active = normed(x, f"{at}.bn1")
        y = F.conv2d(active, state[f"{at}.conv1.weight"], stride=stride, padding=1)
        y = F.conv2d(normed(y, f"{at}.bn2"), state[f"{at}.conv2.weight"], padding=1)
        x = y + F.conv2d(active, state[f"{at}.convShortcut.weight"], stride=stride)
    expected = F.linear(F.adaptive_avg_pool2d(normed(x, "bn1"), 1).flatten(1), state["fc.weight"], state["fc.bias"])
    torch.testing.assert_close(network(images), expected)


def test_resnet18_is_that_of_torchvision_with_a_small_stem():
    ours = drawn(robustbench_net(3, (32, 32), 10, kind="resnet18", depth=18, width=1, mean=[0.0] * 3, std=[1.0] * 3))
    theirs = resnet18(num_classes=10)
    theirs.conv1, theirs.maxpool = torch.nn.Conv2d(3, 64, 3, padding=1, bias=False), torch.nn.Identity()
    names = {name.replace("shortcut", "downsample").replace("linear", "fc"): v for name, v in ours.state_dict().items()}
    theirs.load_state_dict(names)
    images = torch.rand(2, 3, 32, 32)
    torch.testing.assert_close(ours(images), theirs.eval()(images), rtol=1e-4, atol=1e-3)


def test_a_stage_of_resnext_is_that_of_torchvision():
    ours = drawn(robustbench_net(3, (32, 32), 10, kind="resnext", depth=29, width=32, groups=4))
    renamed = {"conv_reduce": "conv1", "bn_reduce": "bn1", "conv_conv": "conv2", "conv_expand": "conv3"}
    renamed |= {"bn_expand": "bn3", "bn": "bn2", "downsample": "downsample"}
    shortcut = torch.nn.Sequential(torch.nn.Conv2d(256, 512, 1, 2, bias=False), torch.nn.BatchNorm2d(512))
    theirs = torch.nn.Sequential(
        Bottleneck(256, 128, 2, shortcut, groups=4, base_width=32),
        *(Bottleneck(512, 128, groups=4, base_width=32) for _ in range(2)),
    )
    state = {}
    for name, value in ours.stage_2.state_dict().items():
        number, layer, rest = name.split(".", 2)
        state[f"{number}.{renamed[layer]}.{rest}"] = value
    theirs.load_state_dict(state)
    x = torch.rand(1, 256, 8, 8)
    torch.testing.assert_close(ours.stage_2(x), theirs.eval()(x), rtol=1e-4, atol=1e-2)


@pytest.mark.parametrize(
    "settings",
    [
        {"kind": "wide_resnet", "depth": 16, "width": 2},
        {"kind": "resnext", "depth": 11, "width": 32, "groups": 4},
        {"kind": "resnet18", "depth": 18, "width": 1},
    ],
)
@pytest.mark.parametrize("wrapped", [False, True])
def test_kind_and_classes_are_read_from_names_and_shapes(tmp_path, settings, wrapped):
    state = robustbench_net(3, (32, 32), 7, **settings).state_dict()
    if wrapped:  # as several of the zoo's files
        state = {f"module.{name}": v for name, v in state.items() if not name.endswith("num_batches_tracked")}
        state |= {"module.mu": torch.full((1, 3, 1, 1), 0.25), "module.sigma": torch.full((1, 3, 1, 1), 0.5)}
        state["module.sub_block1.layer.0.conv1.weight"] = torch.zeros(1)
    torch.save({"state_dict": state, "epoch": 3} if wrapped else state, tmp_path / "Hendrycks2020AugMix_WRN.pt")
    found = read_foreign(f"robustbench:{tmp_path / 'Hendrycks2020AugMix_WRN.pt'}")
    assert found.classes == 7
    assert {key: found.backbone[key] for key in settings} == settings
    assert found.backbone["mean"] == ([0.25] * 3 if wrapped else [0.5] * 3)
    assert "not of Sextant" in found.card()


def test_an_unknown_file_name_leaves_the_standardisation_open(tmp_path):
    torch.save(robustbench_net(3, (32, 32), 10, depth=10, width=1).state_dict(), tmp_path / "mine.pt")
    assert read_foreign(f"robustbench:{tmp_path / 'mine.pt'}").backbone["mean"] is None


class Payload:
    def __reduce__(self):
        return exec, ("raise SystemExit('executed')",)


def test_what_cannot_be_read_is_told(tmp_path):
    torch.save({"state_dict": {"a": torch.zeros(1)}}, tmp_path / "other.pt")
    torch.save({"x": Payload()}, tmp_path / "pickle.pt")
    torch.save([1, 2], tmp_path / "list.pt")
    torch.save(resnet18(num_classes=3).state_dict(), tmp_path / "torchvision.pt")
    for name, said in {
        "other.pt": "neither a Wide ResNet",
        "pickle.pt": "nothing in it was executed",
        "list.pt": "is not a state dict",
        "nothing.pt": "there is no such file",
        "torchvision.pt": "it has no 'linear.weight'",
    }.items():
        with pytest.raises(UserError, match=said):
            read_foreign(f"robustbench:{tmp_path / name}")
    with pytest.raises(UserError, match="model=hub:x: no such source"):
        read_foreign("hub:x")


def test_a_file_of_timm_names_its_network_and_has_its_preprocessing(tmp_path):
    timm = pytest.importorskip("timm")
    network = timm.create_model("mobilenetv3_small_050", num_classes=4).eval()
    save_file(network.state_dict(), tmp_path / "mobilenetv3_small_050.lamb_in1k.safetensors")
    found = read_foreign(f"timm:{tmp_path / 'mobilenetv3_small_050.lamb_in1k.safetensors'}")
    assert (found.backbone["name"], found.classes, found.size) == ("mobilenetv3_small_050", 4, 224)
    assert (found.crop, found.backbone["mean"]) == (0.875, [0.485, 0.456, 0.406])
    own = TimmClassifier(3, (64, 64), 4, **{k: v for k, v in found.backbone.items() if k != "_target_"}).eval()
    own.load_state_dict(found.state)
    images = torch.rand(2, 3, 64, 64)
    mean, std = (torch.tensor(found.backbone[key])[:, None, None] for key in ("mean", "std"))
    with torch.no_grad():
        torch.testing.assert_close(own(images), network((images - mean) / std))
    # a config.json beside a file of any name, as on the hub
    (tmp_path / "hub").mkdir()
    save_file(network.state_dict(), tmp_path / "hub" / "model.safetensors")
    told = {"architecture": "mobilenetv3_small_050", "pretrained_cfg": {"mean": [0.1, 0.2, 0.3], "crop_pct": 1.0}}
    (tmp_path / "hub" / "config.json").write_text(json.dumps(told))
    found = read_foreign(f"timm:{tmp_path / 'hub' / 'model.safetensors'}")
    assert (found.backbone["mean"], found.crop) == ([0.1, 0.2, 0.3], 1.0)
    save_file(network.state_dict(), tmp_path / "weights.safetensors")
    with pytest.raises(UserError, match="Name the file after its network"):
        read_foreign(f"timm:{tmp_path / 'weights.safetensors'}")
    with pytest.raises(UserError, match="there is no such network or file"):
        read_foreign("timm:resnet5000")


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A file of timm's ``mobilenetv3_small_050`` with two logits."""
    timm = pytest.importorskip("timm")
    path = tmp_path_factory.mktemp("timm") / "whole.safetensors"
    save_file(timm.create_model("mobilenetv3_small_050", num_classes=2).state_dict(), path)
    return path


def test_the_tag_in_a_name_or_config_chooses_the_preprocessing(tmp_path):
    timm = pytest.importorskip("timm")
    state = timm.create_model("tf_efficientnet_b0", num_classes=2).state_dict()

    def mean(name):
        save_file(state, tmp_path / name)
        return read_foreign(f"timm:{tmp_path / name}").backbone["mean"]

    assert mean("tf_efficientnet_b0.ap_in1k.safetensors") == [0.5, 0.5, 0.5]
    assert mean("tf_efficientnet_b0.safetensors") == [0.485, 0.456, 0.406]
    with pytest.raises(UserError, match="timm has no weights ap_in2k of tf_efficientnet_b0") as error:
        mean("tf_efficientnet_b0.ap_in2k.safetensors")
    assert "ap_in1k" in error.value.fix
    told = {"architecture": "tf_efficientnet_b0", "pretrained_cfg": {"tag": "ap_in1k"}}
    (tmp_path / "config.json").write_text(json.dumps(told))
    assert mean("model.safetensors") == [0.5, 0.5, 0.5]
    own = {"tag": "mine", "mean": [0.1] * 3, "std": [0.2] * 3, "input_size": [3, 64, 64], "classifier": "classifier"}
    (tmp_path / "config.json").write_text(json.dumps(told | {"pretrained_cfg": own}))
    assert mean("model.safetensors") == [0.1, 0.1, 0.1]
    (tmp_path / "config.json").write_text(json.dumps(told | {"pretrained_cfg": {"tag": "mine"}}))
    with pytest.raises(UserError, match="timm has no weights mine"):
        mean("model.safetensors")


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ("[1]", "is not a config of timm: it must be a mapping"),
        ("{", "is not a config of timm: it must be a mapping"),
        ('{"architecture": "mobilenetv3_small_050", "pretrained_cfg": null}', "its pretrained_cfg must be a mapping"),
        *(
            (
                json.dumps({"architecture": "mobilenetv3_small_050", "pretrained_cfg": {key: value}}),
                rf"of timm: {key}\n",
            )
            for key, value in [
                *(("mean", value) for value in (None, 0.5, [0.5], ["a"] * 3, [float("nan")] * 3)),
                *(
                    ("std", [0, 1, 1]),
                    ("classifier", None),
                    ("classifier", []),
                    ("input_size", [224]),
                    ("crop_pct", "a"),
                ),
            ]
        ),
    ],
)
def test_a_config_that_is_none_is_one_line(small, told, said):
    (small.parent / "config.json").write_text(told)
    with pytest.raises(UserError, match=said) as error:
        read_foreign(f"timm:{small}")
    assert str(small.parent / "config.json") in error.value.problem
