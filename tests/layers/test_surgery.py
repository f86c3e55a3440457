import pytest
import torch
import torch.nn.functional as F
from torch import nn

from sextant.errors import UserError
from sextant.layers import (
    NoInhibition,
    PushPullAvgConv2d,
    PushPullAvgInhibition,
    PushPullConv2d,
    PushPullInhibition,
    Rule,
    convert,
    first_conv,
    inhibit,
    inhibited,
    skipped,
)
from sextant.layers.surgery import exactly
from sextant.models import LeNet


def nested_network():
    stem = nn.Sequential(nn.BatchNorm2d(3), nn.Conv2d(3, 4, 3))
    return nn.ModuleDict({"stem": stem, "body": nn.Conv2d(4, 5, 3)})


def trained(inhibition):
    """Weights before and after a few steps; images are drawn after the surgery, which must not use the generator."""
    torch.manual_seed(0)
    network = inhibition(LeNet("A", 1, (28, 28), 10))
    start = {name: weight.clone() for name, weight in network.state_dict().items()}
    optimizer = torch.optim.SGD(network.parameters(), lr=0.1, momentum=0.9, nesterov=True, weight_decay=5e-4)
    for _ in range(5):
        optimizer.zero_grad()
        F.cross_entropy(network(torch.rand(16, 1, 28, 28)), torch.randint(10, (16,))).backward()
        optimizer.step()
    return start, network.state_dict()


def same(first, second):
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


def test_the_first_convolution_in_registration_order_is_found_at_any_depth():
    network = nested_network()
    path, conv = first_conv(network)
    assert path == "stem.1"
    assert conv is network["stem"][1]


def test_only_the_first_convolution_is_replaced_and_keeps_its_weights():
    network = nested_network()
    first, second = network["stem"][1], network["body"]
    assert PushPullInhibition(scale=1.5, alpha=0.5)(network) is network
    layer = network["stem"][1]
    assert isinstance(layer, PushPullConv2d)
    assert (layer.scale, layer.alpha) == (1.5, 0.5)
    assert layer.weight is first.weight
    assert network["body"] is second


def test_trained_strengths_are_parameters_of_the_network():
    network = PushPullInhibition(train_alpha=True)(nested_network())
    assert dict(network.named_parameters())["stem.1.alpha"].shape == (4,)


def test_no_inhibition_leaves_the_network_as_it_is():
    network = nested_network()
    modules = list(network.modules())
    assert NoInhibition()(network) is network
    assert list(network.modules()) == modules


@pytest.mark.parametrize("network", [nn.Sequential(nn.Flatten(), nn.Linear(4, 2)), nn.Conv2d(1, 1, 3)])
@pytest.mark.parametrize("find", [first_conv, PushPullInhibition()])
def test_a_network_without_a_convolution_inside_is_refused(find, network):
    with pytest.raises(ValueError, match=f"{type(network).__name__} has no Conv2d"):
        find(network)


def test_training_the_twin_is_training_the_network_without_inhibition():
    start, plain = trained(NoInhibition())
    twin_start, twin = trained(PushPullInhibition(scale=1.0, alpha=1.0))
    assert same(twin_start, start)
    assert same(twin, plain)
    assert not same(plain, start)


def test_training_with_inhibition_starts_from_the_same_weights_and_ends_elsewhere():
    start, plain = trained(NoInhibition())
    inhibited_start, inhibited = trained(PushPullInhibition())
    assert same(inhibited_start, start)
    assert not same(inhibited, plain)


def blocks():
    """Convolutions of several kernels, and one that is used twice."""
    shared = nn.Conv2d(4, 4, 3, padding=1)
    return nn.ModuleDict(
        {
            "stem": nn.Conv2d(3, 4, 4, 4),
            "layer1": nn.Sequential(nn.Conv2d(4, 4, 3, padding=1), nn.ReLU(), nn.Conv2d(4, 4, 1)),
            "layer2": nn.Sequential(shared, nn.ReLU(), shared),
            "layer10": nn.Conv2d(4, 4, (3, 5)),
        }
    )


def relu(module):
    return nn.ReLU()


@pytest.mark.parametrize(
    ("pattern", "changed"),
    [
        ("stem", ["stem"]),
        ("layer1.0", ["layer1.0"]),
        ("layer1.*", ["layer1.0", "layer1.2"]),
        ("layer?.*", ["layer1.0", "layer1.2", "layer2.0", "layer2.2"]),
        ("layer[2-9].0", ["layer2.0", "layer2.2"]),
        ("layer1*", ["layer1.0", "layer1.2", "layer10"]),
        ("*", ["stem", "layer1.0", "layer1.2", "layer2.0", "layer2.2", "layer10"]),
    ],
)
def test_a_pattern_changes_the_convolutions_that_match_and_no_others(pattern, changed):
    network = blocks()
    before = dict(network.named_modules(remove_duplicate=False))
    conversion = convert(network, [Rule(pattern, relu)])
    after = dict(network.named_modules(remove_duplicate=False))
    assert list(conversion.changed) == changed
    assert conversion.skipped == {}
    assert after.keys() == before.keys()
    assert [path for path in before if after[path] is not before[path]] == changed


def test_a_module_used_twice_is_replaced_by_one_module_wherever_it_is():
    network = blocks()
    conversion = convert(network, [Rule("layer2.2", PushPullConv2d.from_conv)])
    assert conversion.changed == ("layer2.0", "layer2.2")
    assert network["layer2"][0] is network["layer2"][2]
    assert isinstance(network["layer2"][0], PushPullConv2d)


def test_the_first_rule_that_matches_holds():
    network = blocks()
    convert(network, [Rule("layer1.0", nn.Sequential), Rule("layer1.*", relu), Rule("*.0", relu, kind=nn.ReLU)][:2])
    assert isinstance(network["layer1"][0], nn.Sequential)
    assert isinstance(network["layer1"][2], nn.ReLU)


def test_what_lies_in_a_replaced_module_is_left_alone():
    network = blocks()
    layer1 = network["layer1"]
    inside = list(layer1)
    rules = [Rule("layer1.0", relu), Rule("layer1", lambda old: nn.Sequential(old, nn.ReLU()), kind=nn.Sequential)]
    assert convert(network, rules).changed == ("layer1",)
    assert list(layer1) == inside
    assert network["layer1"][0] is layer1


def test_a_pattern_that_matches_nothing_is_told_with_paths_that_would():
    network = blocks()
    before = list(network.modules())
    with pytest.raises(UserError, match=r"'layer3\.\*' matches no Conv2d of ModuleDict\n.*stem, layer1\.0, layer1\.2"):
        convert(network, [Rule("stem", relu), Rule("layer3.*", relu)])
    assert list(network.modules()) == before


def test_a_network_without_such_modules_is_told():
    with pytest.raises(UserError, match="matches no Conv2d of Sequential\nIt has no Conv2d"):
        convert(nn.Sequential(nn.ReLU()), [Rule("*", relu)])


def test_what_is_objected_to_stays_and_the_reason_is_told():
    def large(module):
        return None if module.kernel_size[0] > 1 else "too small"

    network = blocks()
    conversion = convert(network, [Rule("layer1.*", relu, objection=large)])
    assert conversion.changed == ("layer1.0",)
    assert conversion.skipped == {"layer1.2": "too small"}
    with pytest.raises(UserError, match=r"can be replaced \(layer1\.2: too small\)\n.*stem, layer2\.0"):
        convert(network, [Rule("layer1.*", relu, objection=large)])


@pytest.mark.parametrize("path", ["a.b", "a[0]", "*", "a?b"])
def test_an_exact_pattern_matches_its_path_alone(path):
    rule = Rule(exactly(path), relu)
    conv = nn.Conv2d(1, 1, 1)
    assert rule.matches(conv, [path])
    assert not any(rule.matches(conv, [other]) for other in ("axb", "a0", "a.b.c", "x") if other != path)


@pytest.mark.parametrize(
    ("where", "scale", "changed"),
    [
        ("all", 2.0, ["layer1.0", "layer2.0", "layer10"]),
        ("all", 1.0, ["stem", "layer1.0", "layer2.0", "layer10"]),
        ("layer1.*", 2.0, ["layer1.0"]),
        ("layer2.0", 1.5, ["layer2.0"]),
    ],
)
def test_inhibition_goes_where_it_is_told_but_not_into_1x1_or_even_kernels(where, scale, changed):
    network = blocks()
    weights = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    assert PushPullInhibition(scale=scale, where=where)(network) is network
    assert inhibited(network) == changed
    assert same(network.state_dict(), weights)


@pytest.mark.parametrize(("where", "reason"), [("layer1.2", "no pattern in space"), ("stem", "odd kernel sides")])
def test_a_pattern_of_convolutions_that_cannot_be_inhibited_is_told_why(where, reason):
    with pytest.raises(UserError, match=reason):
        PushPullInhibition(where=where)(blocks())


def test_a_first_convolution_that_cannot_be_inhibited_is_told_why():
    with pytest.raises(ValueError, match="odd kernel sides"):
        PushPullInhibition()(blocks())


def test_the_layer_of_2024_takes_even_kernels_and_keeps_the_weights():
    network = blocks()
    stem = network["stem"]
    PushPullAvgInhibition(average=5, alpha=0.5)(network)
    assert inhibited(network) == ["stem"]
    assert network["stem"].weight is stem.weight
    assert (network["stem"].average, network["stem"].alpha) == (5, 0.5)
    PushPullAvgInhibition(where="layer2.*", train_alpha=True)(network)
    assert isinstance(network["layer2"][2], PushPullAvgConv2d)
    assert network["layer2"][2].alpha.shape == (4,)


class Standardized(nn.Conv2d):
    """A convolution that does something to its weights first."""


@pytest.mark.parametrize(
    "conv",
    [
        Standardized(1, 2, 3),
        nn.utils.parametrizations.weight_norm(nn.Conv2d(1, 2, 3)),
        PushPullConv2d(1, 2, 3),
    ],
)
def test_convolutions_that_compute_more_are_not_silently_made_plain(conv):
    network = nn.Sequential(conv, nn.Conv2d(2, 2, 3))
    conversion = inhibit(network, "all", PushPullConv2d.from_conv)
    assert conversion.changed == ("1",)
    assert "would be lost" in conversion.skipped["0"]
    with pytest.raises(ValueError, match="would be lost"):
        PushPullInhibition()(nn.Sequential(conv))


def a_hook(*args):
    """Any kind of hook may be called with it; it changes nothing."""


@pytest.mark.parametrize(
    ("register", "name"),
    [
        ("register_forward_hook", "forward hook"),
        ("register_forward_pre_hook", "forward pre hook"),
        ("register_full_backward_hook", "full backward hook"),
        ("register_full_backward_pre_hook", "full backward pre hook"),
        ("register_load_state_dict_pre_hook", "load state dict pre hook"),
        ("register_load_state_dict_post_hook", "load state dict post hook"),
        ("register_state_dict_pre_hook", "state dict pre hook"),
    ],
)
def test_a_hook_is_called_by_its_name_and_is_not_dropped(register, name):
    network = nn.Sequential(nn.Conv2d(1, 2, 3), nn.Conv2d(2, 2, 3))
    getattr(network[0], register)(a_hook)
    conversion = inhibit(network, "all", PushPullConv2d.from_conv)
    assert conversion.changed == ("1",)
    assert conversion.skipped["0"].startswith(f"it has a {name}, which would be lost")
    assert type(network[0]) is nn.Conv2d


@pytest.mark.filterwarnings("ignore:.*weight_norm.*:FutureWarning")
@pytest.mark.parametrize(
    ("compute", "name"),
    [(nn.utils.weight_norm, "WeightNorm"), (nn.utils.spectral_norm, "SpectralNorm")],
)
def test_a_weight_that_a_hook_computes_is_told_as_that(compute, name):
    conversion = inhibit(
        nn.Sequential(compute(nn.Conv2d(1, 2, 3)), nn.Conv2d(2, 2, 3)), "all", PushPullConv2d.from_conv
    )
    assert conversion.skipped["0"] == f"{name} computes its weight anew each time, which would be lost"


@pytest.mark.parametrize("inhibition", [PushPullInhibition(where="all"), PushPullAvgInhibition(where="all")])
def test_what_was_skipped_can_be_asked_for(inhibition):
    network = inhibition(blocks())
    told = skipped(network)
    assert told["layer1.2"] == "a 1x1 kernel has no pattern in space"
    assert ("stem" in told) == isinstance(inhibition, PushPullInhibition)  # its kernel has even sides
    assert {*told, *inhibited(network)} >= {"stem", "layer1.0", "layer1.2", "layer2.0", "layer10"}
    assert skipped(blocks()) == skipped(NoInhibition()(blocks())) == {}


def test_what_was_skipped_and_replaced_later_is_no_longer_told():
    network = PushPullInhibition(where="all")(blocks())
    PushPullAvgInhibition(where="stem")(network)
    assert skipped(network).keys() == {"layer1.2"}


def test_several_patterns_may_be_given():
    network = PushPullInhibition(where=["layer1.*", "layer10"])(blocks())
    assert inhibited(network) == ["layer1.0", "layer10"]
    with pytest.raises(UserError, match="'layer3' matches no Conv2d"):
        PushPullInhibition(where=["layer1.*", "layer3"])(blocks())


@pytest.mark.parametrize("where", [[], [1], None, 3])
def test_a_place_that_is_no_pattern_is_refused(where):
    with pytest.raises(ValueError, match="where must be first, first_block, all"):
        PushPullInhibition(where=where)(blocks())


def patches(rest):
    """A stem of patches, as ConvNeXt (with convolutions after it) and ViT (without) have it."""
    return nn.Sequential(nn.Sequential(nn.Conv2d(3, 8, 4, 4)), *rest)


def test_a_first_convolution_that_stays_comes_with_what_would_work():
    convnext = patches([nn.Conv2d(8, 8, 7, padding=3, groups=8)])
    with pytest.raises(ValueError, match=r"the first convolution of Sequential, 0\.0, cannot") as told:
        PushPullInhibition()(convnext)
    assert "where='1'" in str(told.value)
    assert "PushPullAvgInhibition, which also accepts even kernels" in str(told.value)
    assert inhibited(PushPullInhibition(where="1")(convnext)) == ["1"]
    vit = patches([nn.Flatten(), nn.Linear(8, 2)])
    with pytest.raises(ValueError, match=r"odd kernel sides.*Alternatives: PushPullAvgInhibition"):
        PushPullInhibition()(vit)
    assert inhibited(PushPullAvgInhibition()(vit)) == ["0.0"]


def test_an_identity_start_does_not_change_a_trained_networks_outputs():
    network = LeNet("A", 1, (28, 28), 10).eval()
    images = torch.rand(2, 1, 28, 28)
    before = network(images)
    assert torch.equal(PushPullInhibition(scale=1.0, alpha=1.0, where="all")(network)(images), before)
