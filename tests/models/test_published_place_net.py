"""Published place networks: every layout opens, and each aggregation is its paper's equation, computed slowly.

The files hold random weights in the layouts of the authors: no real weights were run.
"""

import math

import numpy as np
import pytest
import torch
from models.published_places import FILES, boq_aggregator, dinov2, mixvpr_aggregator, netvlad, salad_aggregator

from sextant.errors import UserError
from sextant.models.bag_of_queries import BagOfQueries
from sextant.models.published_arrays import tensors_of
from sextant.models.published_place_file import kind_of, read_published_places
from sextant.models.published_place_net import PublishedPlaceNet
from sextant.models.transported_features import TransportedFeatures, transported
from sextant.models.vision_transformer import resampled_positions


def built(found):
    network = PublishedPlaceNet(3, found.image_size, 0, **found.settings)
    network.load_state_dict(found.state)
    return network.eval()


LARGE = [pytest.param(name, marks=pytest.mark.slow) for name in FILES if "megaloc" in name or "boq" in name]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*(name for name in FILES if "megaloc" not in name and "boq" not in name), *LARGE])
def test_each_layout_opens_and_gives_the_published_dimension(name):
    make, title, dimension, size = FILES[name]
    found = read_published_places(make(), name)
    assert (found.title, found.dimension, found.image_size) == (title, dimension, size)
    with torch.no_grad():
        described = built(found)(torch.rand(1, 3, *size))
    assert described.shape == (1, dimension)
    assert described.norm().item() == pytest.approx(1, abs=1e-5)


def unit(x, axis=-1):
    return x / np.linalg.norm(x, axis=axis, keepdims=True)


def normed(x, weight, bias, eps=1e-5):
    return (x - x.mean(-1, keepdims=True)) / np.sqrt(x.var(-1, keepdims=True) + eps) * weight + bias


def softmax(x, axis):
    x = np.exp(x - x.max(axis, keepdims=True))
    return x / x.sum(axis, keepdims=True)


def attended(query, key, get, name, heads):
    """Multi-head attention of one image, head by head."""
    width = query.shape[1]
    weight, bias = get(f"{name}.in_proj_weight"), get(f"{name}.in_proj_bias")
    q, k, v = (
        x @ weight[i * width : (i + 1) * width].T + bias[i * width : (i + 1) * width]
        for i, x in enumerate((query, key, key))
    )
    size = width // heads
    parts = [slice(h * size, (h + 1) * size) for h in range(heads)]
    found = [softmax(q[:, p] @ k[:, p].T / math.sqrt(size), 1) @ v[:, p] for p in parts]
    return np.concatenate(found, 1) @ get(f"{name}.out_proj.weight").T + get(f"{name}.out_proj.bias")


def test_bag_of_queries_is_the_papers():
    torch.manual_seed(0)
    arrays = boq_aggregator("", 6, 128, 3, queries=5, layers=2)
    pooling = BagOfQueries(6, (3, 4), width=128, queries=5, layers=2, rows=3).eval()
    pooling.load_state_dict(arrays)
    features = torch.randn(1, 6, 3, 4)
    double = {name: value.double().numpy() for name, value in arrays.items()}
    padded = np.pad(features[0].double().numpy(), ((0, 0), (1, 1), (1, 1)))
    cells = np.array(
        [
            np.tensordot(double["proj_c.weight"], padded[:, r : r + 3, c : c + 3], 3) + double["proj_c.bias"]
            for r in range(3)
            for c in range(4)
        ]
    )
    x = normed(cells, double["norm_input.weight"], double["norm_input.bias"])
    outputs = []
    for layer in range(2):

        def get(name, layer=layer):
            return double[f"boqs.{layer}.{name}"]

        def norm(x, name, get=get):
            return normed(x, get(f"{name}.weight"), get(f"{name}.bias"))

        x = norm(x + attended(x, x, get, "encoder.self_attn", 2), "encoder.norm1")
        hidden = np.maximum(x @ get("encoder.linear1.weight").T + get("encoder.linear1.bias"), 0)
        x = norm(x + hidden @ get("encoder.linear2.weight").T + get("encoder.linear2.bias"), "encoder.norm2")
        queries = get("queries")[0]
        asked = norm(queries + attended(queries, queries, get, "self_attn", 2), "norm_q")
        outputs.append(norm(attended(asked, x, get, "cross_attn", 2), "norm_out"))
    wanted = (double["fc.weight"] @ np.concatenate(outputs) + double["fc.bias"][:, None]).T
    with torch.no_grad():
        np.testing.assert_allclose(pooling(features)[0].numpy(), unit(wanted.reshape(-1)), atol=2e-6)


def test_transport_is_sinkhorns():
    scores, dustbin = torch.randn(2, 3, 7), torch.tensor(0.4)
    plan = transported(scores, dustbin)
    for own, each in zip(plan.numpy(), scores.double().numpy(), strict=True):
        kernel = np.exp(np.vstack([each, np.full((1, 7), 0.4)]))
        rows, columns = np.array([1.0, 1, 1, 4]), np.ones(7)
        right = np.ones(7)
        for _ in range(3):
            left = rows / (kernel @ right)
            right = columns / (kernel.T @ left)
        wanted = left[:, None] * kernel * right
        np.testing.assert_allclose(own, wanted[:3], rtol=1e-5)
        np.testing.assert_allclose(wanted.sum(0), 1)


def test_salad_is_the_papers():
    torch.manual_seed(1)
    arrays = salad_aggregator("", 8, 5, hidden=16, clusters=3, token=4)
    arrays["dust_bin"] = torch.tensor(0.7)
    pooling = TransportedFeatures(8, 12, clusters=3, cluster_width=5, token_width=4, hidden=16)
    pooling.load_state_dict(arrays)
    features, token = torch.randn(2, 8, 3, 4), torch.randn(2, 8)

    def perceptron(x, name, last):
        hidden = np.maximum(arrays[f"{name}.0.weight"].numpy().reshape(16, 8) @ x + arrays[f"{name}.0.bias"].numpy(), 0)
        weight = arrays[f"{name}.{last}.weight"].numpy()
        return weight.reshape(len(weight), 16) @ hidden + arrays[f"{name}.{last}.bias"].numpy()

    for k in range(2):
        cells = [features[k, :, r, c].numpy() for r in range(3) for c in range(4)]
        plan = transported(
            torch.tensor(np.array([perceptron(cell, "score", 3) for cell in cells]).T[None]), torch.tensor(0.7)
        )[0].numpy()
        sums = [
            unit(sum(plan[m, i] * perceptron(cell, "cluster_features", 3) for i, cell in enumerate(cells)))
            for m in range(3)
        ]
        local = np.array(sums).T.reshape(-1)  # number by number
        wanted = unit(np.concatenate([unit(perceptron(token[k].numpy(), "token_features", 2)), local]))
        with torch.no_grad():
            np.testing.assert_allclose(pooling(features, token)[k].numpy(), wanted, atol=1e-6)
    with pytest.raises(UserError, match="12 cells has too few for 12 clusters"):
        TransportedFeatures(8, 12, clusters=12, cluster_width=5, token_width=4)


def test_mixvpr_of_a_file_is_the_papers():
    torch.manual_seed(2)
    trunk = {k: v for k, v in FILES["mixvpr"][0]().items() if k.startswith("backbone")}
    arrays = trunk | mixvpr_aggregator("aggregator.", cells=16, out=6, rows=2, depth=2)
    network = built(read_published_places(arrays, "file"))
    image = torch.rand(1, 3, 64, 64)
    with torch.no_grad():
        x = network.trunk(network.standardize(image))[0].flatten(1).numpy()
        found = network(image)[0].numpy()

    def get(name):
        return arrays[f"aggregator.{name}"].numpy()

    for k in range(2):
        norm = normed(x, get(f"mix.{k}.mix.0.weight"), get(f"mix.{k}.mix.0.bias"))
        hidden = np.maximum(norm @ get(f"mix.{k}.mix.1.weight").T + get(f"mix.{k}.mix.1.bias"), 0)
        x = x + hidden @ get(f"mix.{k}.mix.3.weight").T + get(f"mix.{k}.mix.3.bias")
    mixed = get("channel_proj.weight") @ x + get("channel_proj.bias")[:, None]
    wanted = mixed @ get("row_proj.weight").T + get("row_proj.bias")
    np.testing.assert_allclose(found, unit(wanted.reshape(-1)), atol=1e-5)


def test_cosplace_of_a_file_is_the_papers():
    arrays = FILES["cosplace_resnet18"][0]()
    arrays["aggregation.1.p"] = torch.tensor([2.3])
    network = built(read_published_places(arrays, "file"))
    image = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        features = network.trunk(network.standardize(image))[0].flatten(1).double().numpy()
        found = network(image)[0].numpy()
    pooled = (np.maximum(unit(features, 0), 1e-6) ** 2.3).mean(1) ** (1 / 2.3)
    wanted = arrays["aggregation.3.weight"].double().numpy() @ pooled + arrays["aggregation.3.bias"].numpy()
    np.testing.assert_allclose(found, unit(wanted), atol=1e-5)


def test_netvlad_of_a_file_is_the_papers():
    arrays = netvlad(clusters=3, whitened=7)
    network = built(read_published_places(arrays, "file"))
    image = torch.rand(1, 3, 48, 64)
    with torch.no_grad():
        cells = unit(network.trunk(network.standardize(image))[0].flatten(1).T.double().numpy())
        found = network(image)[0].numpy()
    centres, weight = (arrays[f"pool.{name}"].double().numpy() for name in ("centroids", "conv.weight"))
    share = softmax(cells @ weight[:, :, 0, 0].T, 1)
    residuals = np.array([sum(share[i, k] * (cell - centres[k]) for i, cell in enumerate(cells)) for k in range(3)])
    vlad = unit(unit(residuals).reshape(-1))
    wanted = arrays["WPCA.0.weight"][:, :, 0, 0].double().numpy() @ vlad + arrays["WPCA.0.bias"].numpy()
    np.testing.assert_allclose(found, unit(wanted), atol=1e-5)


def test_the_transformer_is_dinov2s():
    """Patches, positions, and a block of attention and perceptron with scales, in slow arithmetic."""
    torch.manual_seed(3)
    arrays = dinov2("", width=128, side=3) | {"norm.weight": torch.randn(128)}
    settings = {"kind": "salad", "trunk": "vit", "blocks": [1]}
    sizes = {"width": 128, "patch": 14, "clusters": 2, "cluster_width": 2, "token_width": 2, "hidden": 4}
    network = PublishedPlaceNet(3, (28, 42), 0, sizes=sizes, **settings).eval()
    positions = resampled_positions(arrays["pos_embed"], (2, 3))
    network.trunk.load_state_dict({k: v for k, v in arrays.items() if k != "mask_token"} | {"pos_embed": positions})
    image = torch.randn(1, 3, 28, 42)
    get = {name: value.double().numpy() for name, value in arrays.items()}
    patches = [image[0, :, r : r + 14, c : c + 14].double().numpy() for r in (0, 14) for c in (0, 14, 28)]
    rows = [np.tensordot(get["patch_embed.proj.weight"], patch, 3) + get["patch_embed.proj.bias"] for patch in patches]
    x = np.vstack([get["cls_token"][0], rows]) + positions[0].double().numpy()
    block = {name.removeprefix("blocks.0."): value for name, value in get.items()}
    fused = {"a.in_proj_weight": block["attn.qkv.weight"], "a.in_proj_bias": block["attn.qkv.bias"]}
    fused |= {f"a.out_proj.{name}": block[f"attn.proj.{name}"] for name in ("weight", "bias")}
    before = normed(x, block["norm1.weight"], block["norm1.bias"], 1e-6)
    x = x + block["ls1.gamma"] * attended(before, before, fused.__getitem__, "a", 2)
    before = normed(x, block["norm2.weight"], block["norm2.bias"], 1e-6) @ block["mlp.fc1.weight"].T
    hidden = before + block["mlp.fc1.bias"]
    hidden = hidden * 0.5 * (1 + np.vectorize(math.erf)(hidden / math.sqrt(2)))
    x = x + block["ls2.gamma"] * (hidden @ block["mlp.fc2.weight"].T + block["mlp.fc2.bias"])
    wanted = normed(x, get["norm.weight"], get["norm.bias"], 1e-6)
    with torch.no_grad():
        np.testing.assert_allclose(network.trunk.forward_features(image)[0].numpy(), wanted, atol=1e-5)


def test_positions_are_resampled_as_by_dinov2():
    """Bicubic with a = -0.75, at (i + 1/2) / s - 1/2 for the factor s = (n + 0.1) / side; borders are repeated."""
    side, grid = 5, (3, 4)
    positions = torch.randn(1, side * side + 1, 2)
    square = positions[0, 1:].double().numpy().reshape(side, side, 2)

    def weights(count):
        table = np.zeros((count, side))
        for i in range(count):
            at = (i + 0.5) * side / (count + 0.1) - 0.5
            for k in range(math.floor(at) - 1, math.floor(at) + 3):
                t = abs(at - k)
                near = 1.25 * t**3 - 2.25 * t**2 + 1
                weight = near if t <= 1 else -0.75 * t**3 + 3.75 * t**2 - 6 * t + 3
                table[i, min(max(k, 0), side - 1)] += weight
        return table

    wanted = np.einsum("ri,cj,ijd->rcd", weights(3), weights(4), square).reshape(12, 2)
    found = resampled_positions(positions, grid)[0]
    np.testing.assert_allclose(found[1:].numpy(), wanted, atol=1e-5)
    assert torch.equal(found[0], positions[0, 0])
    assert torch.equal(resampled_positions(positions, (5, 5)), positions)


@pytest.mark.parametrize(
    ("registers", "gated", "peer"),
    [(4, 0, "vit_small_patch14_reg4_dinov2"), (0, 2048, None), (4, 2048, None)],
)
def test_transformers_with_registers_or_gated_layers_are_timms(registers, gated, peer):
    """Against timm's own models and its own conversion of the authors' arrays."""
    from timm.layers import SwiGLUPacked
    from timm.models.vision_transformer import VisionTransformer, checkpoint_filter_fn

    torch.manual_seed(4)
    sizes = {"registers": registers} if registers else {}
    sizes |= {"gated": gated} if gated else {}
    arrays = dinov2("backbone.model.", width=384, **sizes) | salad_aggregator("aggregator.", 384, 8)
    found = read_published_places(arrays, "their.ckpt")
    assert {name: found.settings["sizes"].get(name, 0) for name in ("registers", "gated")} == {
        "registers": registers, "gated": gated
    }  # fmt: skip
    more = {"reg_tokens": registers, "no_embed_class": True} if registers else {}
    more |= {"mlp_ratio": gated / 384, "mlp_layer": SwiGLUPacked, "act_layer": torch.nn.SiLU} if gated else {}
    theirs = VisionTransformer(
        img_size=322, patch_size=14, embed_dim=384, depth=1, num_heads=6, init_values=1e-5, num_classes=0, **more
    ).eval()
    if peer:
        import timm

        built_in = timm.create_model(peer, img_size=322, num_classes=0, depth=1)
        assert {k: v.shape for k, v in built_in.state_dict().items()} == {
            k: v.shape for k, v in theirs.state_dict().items()
        }
    plain = {name.removeprefix("backbone.model."): value for name, value in arrays.items() if "backbone" in name}
    if not registers:  # timm resamples these without DINOv2's 0.1 too many
        plain["pos_embed"] = resampled_positions(plain["pos_embed"], (23, 23))
    theirs.load_state_dict(checkpoint_filter_fn(plain, theirs))
    ours, image = built(found), torch.rand(1, 3, 322, 322)
    with torch.no_grad():
        difference = ours.trunk.forward_features(image) - theirs.forward_features(image)
    assert difference.abs().max() < 1e-4


def wrong(change):
    arrays = dict(FILES["salad"][0]())
    change(arrays)
    with pytest.raises(UserError) as raised:
        read_published_places(arrays, "their.ckpt")
    return raised.value


def test_a_partial_file_is_refused_with_its_names():
    told = wrong(lambda arrays: arrays.pop("aggregator.score.3.weight"))
    assert "their.ckpt looks like SALAD by aggregator.dust_bin" in told.problem
    assert "it lacks aggregator.score.3.weight" in told.problem
    assert "MegaLoc" in told.fix
    assert "it lacks aggregator.score.0.weight" in wrong(lambda arrays: arrays.pop("aggregator.score.0.weight")).problem
    told = wrong(lambda arrays: arrays.update({"aggregator.score.3.weight": torch.zeros(65, 512, 1, 1)}))
    assert "another shape aggregator.score.3.weight (65x512x1x1 instead of 64x512x1x1)" in told.problem
    assert (
        "also holds adapter.weight" in wrong(lambda arrays: arrays.update({"adapter.weight": torch.zeros(1)})).problem
    )
    told = wrong(lambda arrays: arrays.update({"backbone.model.pos_embed": torch.zeros(1, 11, 768)}))
    assert "backbone.model.pos_embed ((1, 11, 768) are not positions" in told.problem
    without_trunk = [name for name in FILES["salad"][0]() if name.startswith("backbone")]
    assert "no trunk that is known" in wrong(lambda arrays: [arrays.pop(name) for name in without_trunk]).problem
    told = wrong(lambda arrays: arrays.update({"backbone.model.blocks.2.norm1.weight": torch.zeros(768)}))
    assert "it lacks backbone.model.blocks.1.norm1.weight" in told.problem


def test_another_network_is_refused_with_the_kinds_that_are_known():
    arrays = {"layer1.weight": torch.zeros(2), "layer2.weight": torch.zeros(3)}
    assert kind_of(arrays) is None
    with pytest.raises(UserError, match=r"2 arrays \(layer1\.weight, layer2\.weight") as raised:
        read_published_places(arrays, "file")
    for title in ("BoQ", "SALAD", "MegaLoc", "MixVPR", "CosPlace or EigenPlaces", "NetVLAD", "descriptors="):
        assert title in raised.value.fix
    assert tensors_of([1, 2]) is None
    assert tensors_of({"state_dict": {"a": 1}}) is None
