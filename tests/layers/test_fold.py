"""Folded networks against the ones they come from, in torch, exported by torch.export, and in ONNX."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from layers.convolution_cases import NUMPY_BORDER, convolutions
from torch import nn

from sextant.errors import UserError
from sextant.layers import PushPullAvgConv2d, PushPullConv2d, PushPullInhibition, fold
from sextant.models import LeNet


def network(bias=True, padding_mode="zeros"):
    torch.manual_seed(0)
    return nn.Sequential(
        PushPullConv2d(3, 8, 3, 2, 1, bias=bias, padding_mode=padding_mode),
        nn.BatchNorm2d(8),
        nn.ReLU(),
        PushPullConv2d(8, 6, (3, 5), padding="same", groups=2, train_alpha=True, bias=bias),
        PushPullAvgConv2d(6, 5, 3, padding=1, bias=bias, alpha=0.5),
        nn.Flatten(),
        nn.LazyLinear(4),
    ).eval()


@pytest.fixture
def images():
    return torch.randn(2, 3, 17, 18, generator=torch.Generator().manual_seed(1))


@given(convolutions(), st.floats(1.0, 2.5), st.floats(0, 3), st.booleans())
def test_a_folded_layer_is_the_layer(case, scale, alpha, averaged):
    conv, images = case
    strengths = [alpha * (1 + channel) for channel in range(conv.out_channels)]
    layer = (
        PushPullAvgConv2d.from_conv(conv, alpha=strengths)
        if averaged
        else PushPullConv2d.from_conv(conv, scale=scale, alpha=strengths)
    )
    torch.testing.assert_close(fold(layer)(images), layer(images), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("padding_mode", list(NUMPY_BORDER))
@pytest.mark.parametrize("bias", [False, True])
def test_a_folded_network_is_the_network(bias, padding_mode, images):
    original = network(bias, padding_mode)
    expected = original(images)
    folded = fold(original.train())
    torch.testing.assert_close(folded(images), expected, rtol=1e-5, atol=1e-5)
    assert original.training
    assert isinstance(original[0], PushPullConv2d)
    assert not any(isinstance(m, PushPullConv2d | PushPullAvgConv2d) for m in folded.modules())
    assert not any(parameter.requires_grad for parameter in folded.parameters())


def test_under_autocast_a_folded_layer_has_the_type_of_a_convolution(images):
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        assert fold(PushPullAvgConv2d(3, 4, 3))(images).dtype == torch.bfloat16


def test_the_twin_folds_to_the_convolution():
    layer = PushPullConv2d(2, 3, 4, padding="same", scale=1.0, alpha=1.0)
    folded, images = fold(layer), torch.randn(1, 2, 9, 9)
    assert type(folded) is nn.Conv2d
    assert torch.equal(folded(images), layer(images))


def test_a_layer_used_twice_is_folded_once():
    layer = PushPullConv2d(2, 2, 3, padding=1)
    folded = fold(nn.Sequential(layer, nn.ReLU(), layer))
    assert folded[0] is folded[2]


def test_a_folded_push_pull_layer_exports_as_two_convolutions_two_relus_and_a_difference(images):
    original = nn.Sequential(PushPullConv2d(3, 8, 3, 2, 1)).eval()
    program = torch.export.export(fold(original), (images,))
    operations = [str(node.target) for node in program.graph.nodes if node.op == "call_function"]
    assert sorted(operations) == ["aten.conv2d.default"] * 2 + ["aten.relu.default"] * 2 + ["aten.sub.Tensor"]
    torch.testing.assert_close(program.module()(images), original(images), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("folded", [False, True])
def test_torch_export_gives_the_same_outputs(folded, images):
    original = network()
    expected = original(images)
    program = torch.export.export(fold(original) if folded else original, (images,))
    torch.testing.assert_close(program.module()(images), expected, rtol=1e-5, atol=1e-5)


def test_torch_export_works_with_the_image_size_left_open(images):
    layer = PushPullConv2d(3, 8, 3, padding=1).eval()
    sides = {2: torch.export.Dim("height", min=8, max=64), 3: torch.export.Dim("width", min=8, max=64)}
    program = torch.export.export(layer, (images,), dynamic_shapes=(sides,))
    larger = torch.randn(2, 3, 30, 41)
    torch.testing.assert_close(program.module()(larger), layer(larger), rtol=1e-5, atol=1e-5)


LAYERS = {
    "direct": lambda: PushPullConv2d(3, 8, 3, 2, 1, impl="direct"),
    "rows": lambda: PushPullConv2d(3, 8, 3, 2, 1, impl="rows"),
    "factorised": lambda: PushPullConv2d(3, 8, 3, 2, 1, impl="factorised"),
    "stem": lambda: PushPullConv2d(3, 64, 7, 2, 3),
    "same": lambda: PushPullConv2d(3, 8, (3, 5), padding="same", alpha=[0.2 * i for i in range(8)]),
    "trained": lambda: PushPullConv2d(3, 8, 3, padding=1, padding_mode="reflect", train_alpha=True),
    "averaged": lambda: PushPullAvgConv2d(3, 8, 3, padding=1, train_alpha=True),
}
every_layer = pytest.mark.parametrize("make", LAYERS.values(), ids=LAYERS)


def trained(make):
    """A network with the layer; where strengths are trained, some act as zero."""
    torch.manual_seed(0)
    layer = make()
    if isinstance(layer.alpha, nn.Parameter):
        layer.alpha.data[::2] *= -1
    return nn.Sequential(layer, nn.ReLU())


@every_layer
def test_torch_fx_traces_a_network_that_is_not_folded_and_it_can_be_trained_on(make, images):
    original = trained(make)
    traced = torch.fx.symbolic_trace(original)
    assert torch.equal(traced(images), original(images))
    larger = torch.randn(2, 3, 30, 41)
    assert torch.equal(traced(larger), original(larger))
    traced(images).sum().backward()
    assert original[0].weight.grad.abs().sum() > 0


@every_layer
@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning", "ignore:.*torch.jit:FutureWarning")
def test_torch_jit_trace_holds_for_other_image_sizes(make, images):
    original = trained(make).eval()
    traced = torch.jit.trace(original, (images,))
    for size in ((17, 18), (30, 41)):
        other = torch.randn(2, 3, *size)
        torch.testing.assert_close(traced(other), original(other), rtol=1e-5, atol=1e-5)


@every_layer
@pytest.mark.filterwarnings("ignore:.*torch.jit:FutureWarning")
def test_torch_jit_script_is_refused_with_the_advice_to_fold_which_works(make, images):
    original = trained(make).eval()
    with pytest.raises(UserError, match=r"torch\.jit\.script\(fold\(network\)\)"):
        torch.jit.script(original)
    torch.testing.assert_close(torch.jit.script(fold(original))(images), original(images), rtol=1e-5, atol=1e-5)


@every_layer
@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning", "ignore::FutureWarning", "ignore::DeprecationWarning")
def test_the_older_onnx_exporter_takes_a_network_that_is_not_folded(make, images, tmp_path):
    original = trained(make).eval()
    _, outputs = onnx_outputs(original, images, tmp_path / "network.onnx", dynamo=False)
    torch.testing.assert_close(outputs, original(images), rtol=1e-5, atol=1e-5)


def onnx_outputs(model, images, path, dynamo=True):
    """Operations of the ONNX file and what onnxruntime computes with it."""
    onnx = pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnxscript")
    torch.onnx.export(model, (images,), path, dynamo=dynamo, verbose=False)
    session = runtime.InferenceSession(path, providers=["CPUExecutionProvider"])
    outputs = session.run(None, {session.get_inputs()[0].name: images.numpy()})
    return [node.op_type for node in onnx.load(path).graph.node], torch.from_numpy(outputs[0])


@pytest.mark.slow
def test_a_folded_push_pull_layer_is_conv_relu_and_sub_in_onnx(images, tmp_path):
    original = nn.Sequential(PushPullConv2d(3, 8, 3, 2, 1, alpha=0.7)).eval()
    operations, outputs = onnx_outputs(fold(original), images, tmp_path / "layer.onnx")
    assert sorted(operations) == ["Conv", "Conv", "Relu", "Relu", "Sub"]
    torch.testing.assert_close(outputs, original(images), rtol=1e-5, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("padding_mode", ["zeros", "reflect", "replicate"])
def test_onnx_gives_the_same_outputs(padding_mode, images, tmp_path):
    original = network(padding_mode=padding_mode)
    expected = original(images)
    _, outputs = onnx_outputs(fold(original), images, tmp_path / "network.onnx")
    torch.testing.assert_close(outputs, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_lenet_with_inhibition_in_onnx(tmp_path):
    torch.manual_seed(0)
    lenet = PushPullInhibition()(LeNet("A", 1, (28, 28), 10)).eval()
    images = torch.rand(3, 1, 28, 28)
    _, outputs = onnx_outputs(fold(lenet), images, tmp_path / "lenet.onnx")
    torch.testing.assert_close(outputs, lenet(images), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("layer", [PushPullConv2d(3, 8, 3, padding=1), PushPullAvgConv2d(3, 8, 3, padding=1)])
def test_layers_compile_whole_for_any_image_size(layer):
    compiled = torch.compile(layer, backend="eager", fullgraph=True)
    for size in ((17, 18), (30, 41)):
        images = torch.randn(2, 3, *size)
        torch.testing.assert_close(compiled(images), layer(images), rtol=1e-5, atol=1e-5)
