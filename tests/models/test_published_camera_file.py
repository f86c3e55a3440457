"""Published networks for cameras: every layout opens, each part is its paper's equation, a wrong file is refused.

The files hold random weights in the layouts of the authors: no real weights were run.
"""

import pickle

import numpy as np
import pytest
import torch
from models.published_cameras import FILES, anycalib, geocalib
from safetensors.torch import save_file

from sextant.errors import UserError
from sextant.models.field_net import FACTORS, STEPS, StripAttention, decomposed
from sextant.models.published_camera_file import MARKS, read_published_camera_net
from sextant.models.ray_net import rays_of_tangents, upsampled


@pytest.fixture(autouse=True)
def _no_gradients():
    torch.manual_seed(0)
    with torch.no_grad():
        yield


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("ending", ["tar", "safetensors"])
def test_each_layout_opens_and_predicts(kind, ending, tmp_path):
    path, arrays = tmp_path / f"theirs.{ending}", FILES[kind]()
    if ending == "tar":  # as a training checkpoint
        torch.save({"epoch": 3, "model": arrays}, path)
    else:
        save_file(arrays, path)
    network = read_published_camera_net(kind, path).network
    if kind == "anycalib":
        rays = network(torch.rand(1, 3, 56, 84))
        assert rays.shape == (1, 3, 56, 84)
        assert rays.norm(dim=1) == pytest.approx(1, abs=1e-5)
        return
    field = network(torch.rand(1, 3, 64, 96))
    assert field.latitude.shape == field.latitude_confidence.shape == (1, 64, 96)
    assert field.up.norm(dim=1) == pytest.approx(1, abs=1e-5)
    assert 0 < field.up_confidence.min() <= field.up_confidence.max() < 1


def test_every_array_of_the_file_is_used(tmp_path):
    for kind, make in FILES.items():
        arrays = make()
        torch.save(arrays, tmp_path / "whole.pt")
        state = read_published_camera_net(kind, tmp_path / "whole.pt").network.state_dict()
        kept = [name for name in arrays if not any(part in name for part in ("mask_token", ".model.norm.", "image_"))]
        assert len([name for name in state if not name.endswith("num_batches_tracked")]) == len(kept)
        assert sum(float(value.double().sum()) for value in state.values()) == pytest.approx(
            sum(float(arrays[name].double().sum()) for name in kept)
        )


def test_geocalibs_names_may_have_a_further_part_and_its_file_further_arrays(tmp_path):
    arrays = geocalib()
    longer = {name.replace(".", ".wrapped.", 1): value for name, value in arrays.items()}
    torch.save(longer | {"loss.wrapped.weight": torch.zeros(2)}, tmp_path / "theirs.tar")
    torch.save(arrays, tmp_path / "plain.tar")
    found, plain = (read_published_camera_net("geocalib", tmp_path / f"{name}.tar") for name in ("theirs", "plain"))
    assert (found.unused, plain.unused) == (("loss.weight",), ())
    for mine, other in zip(found.network.state_dict().values(), plain.network.state_dict().values(), strict=True):
        assert torch.equal(mine, other)


def test_the_decomposition_is_lee_and_seungs():
    cells = torch.rand(1, 6, 10, dtype=torch.float64)
    found = decomposed(cells)[0].numpy()
    x = cells[0].numpy()
    bases = torch.rand(1, 6, FACTORS, generator=torch.Generator().manual_seed(0))[0].double().numpy()
    bases = bases / np.linalg.norm(bases, axis=0)
    shares = np.exp(x.T @ bases)
    shares /= shares.sum(1, keepdims=True)
    for step in range(STEPS + 1):
        shares = shares * (x.T @ bases) / (shares @ bases.T @ bases + 1e-6)
        if step < STEPS:
            bases = bases * (x @ shares) / (bases @ shares.T @ shares + 1e-6)
    np.testing.assert_allclose(found, bases @ shares.T, atol=1e-6)
    assert np.abs(found - x).mean() < 0.1


def test_attention_weighs_a_cell_by_crossed_strips():
    """One channel whose strips are sums: the gate of a cell counts the cells that the crossed strips reach."""
    attention = StripAttention(1)
    for name, value in attention.state_dict().items():
        value.fill_(0.0 if name.endswith("bias") else 1.0)
    image = torch.zeros(1, 1, 31, 31)
    image[0, 0, 15, 15] = 1.0
    attention.before.bias.fill_(0.0)
    inner = torch.nn.functional.gelu(image)
    near = torch.nn.functional.conv2d(inner, torch.ones(1, 1, 5, 5), padding=2)
    gate = near.clone()
    for length in (7, 11, 21):
        gate += torch.nn.functional.conv2d(near, torch.ones(1, 1, length, length), padding=length // 2)
    torch.testing.assert_close(attention(image), image + gate * inner)


def test_upsampling_is_a_weighted_mean_of_nine_cells():
    cells, logits = torch.rand(1, 1, 3, 4), torch.rand(1, 9 * 4, 3, 4)
    found = upsampled(cells, logits, 2)[0, 0].numpy()
    padded = np.pad(cells[0, 0].numpy(), 1)
    weights = np.exp(logits[0].numpy().reshape(9, 2, 2, 3, 4))
    weights /= weights.sum(0)
    for row in range(6):
        for column in range(8):
            (i, r), (j, c) = divmod(row, 2), divmod(column, 2)
            wanted = weights[:, r, c, i, j] @ padded[i : i + 3, j : j + 3].ravel()
            assert found[row, column] == pytest.approx(wanted, abs=1e-6)


def test_a_tangent_is_an_angle_and_a_direction():
    tangents = torch.tensor([[0.3, 0.4], [0.0, 0.0]]).T.reshape(1, 2, 1, 2)
    rays = rays_of_tangents(tangents)[0, :, 0].T
    wanted = [[0.6 * np.sin(0.5), 0.8 * np.sin(0.5), np.cos(0.5)], [0, 0, 1]]
    np.testing.assert_allclose(rays.numpy(), wanted, atol=1e-6)


def changed(kind, change):
    arrays = FILES[kind]()
    change(arrays)
    return arrays


@pytest.mark.parametrize(
    ("kind", "content", "says"),
    [
        ("geocalib", anycalib, "is not a file of GeoCalib: its arrays are those of AnyCalib"),
        ("anycalib", geocalib, "is not a file of AnyCalib: its arrays are those of GeoCalib"),
        ("anycalib", lambda: {"fc.weight": torch.zeros(2)}, "is not a file of AnyCalib: it holds fc.weight"),
        ("geocalib", lambda: [torch.zeros(2)], "is not a state dict"),
        (
            "geocalib",
            lambda: changed("geocalib", lambda a: a.update({MARKS["geocalib"]: a[MARKS["geocalib"]].to_sparse()})),
            "is not a file of GeoCalib",
        ),
        (
            "geocalib",
            lambda: {name: value.to(torch.complex64) for name, value in FILES["geocalib"]().items()},
            "is not a state dict",
        ),
        (
            "anycalib",
            lambda: changed("anycalib", lambda a: a.update({"backbone.model.pos_embed": torch.ones(1, 0, 64)})),
            "has in another shape backbone.model.pos_embed",
        ),
        (
            "geocalib",
            lambda: changed("geocalib", lambda a: a.pop("backbone.block3.0.mlp.fc2.weight")),
            "does not fit it: it lacks backbone.block3.0.mlp.fc2.weight",
        ),
        ("geocalib", lambda: changed("geocalib", lambda a: a.pop("backbone.norm2.weight")), "it lacks backbone.norm2"),
        (
            "geocalib",
            lambda: changed("geocalib", lambda a: a.update({"ll_enc.conv2.conv.bias": torch.zeros(3)})),
            r"it has in another shape ll_enc.conv2.conv.bias \(3 instead of 8\)",
        ),
        ("anycalib", lambda: changed("anycalib", lambda a: a.update(more=torch.zeros(3))), "it also holds more"),
        (
            "anycalib",
            lambda: changed("anycalib", lambda a: a["head.tangent_head.2.bias"].fill_(torch.nan)),
            "not finite",
        ),
    ],
)
def test_a_wrong_file_is_refused_in_a_sentence(kind, content, says, tmp_path):
    torch.save(content(), tmp_path / "theirs.pt")
    with pytest.raises(UserError, match=says):
        read_published_camera_net(kind, tmp_path / "theirs.pt")


class Harm:
    def __reduce__(self):
        return print, ("executed",)


def test_what_is_no_weights_is_not_executed(tmp_path, capsys):
    (tmp_path / "harm.pt").write_bytes(pickle.dumps(Harm()))
    torch.save({"model": Harm()}, tmp_path / "harm.tar")
    (tmp_path / "cut.safetensors").write_bytes(b"abc")
    for name in ("harm.pt", "harm.tar", "cut.safetensors"):
        with pytest.raises(UserError, match="cannot be read; nothing in it was executed"):
            read_published_camera_net("geocalib", tmp_path / name)
    with pytest.raises(UserError, match="there is no such file"):
        read_published_camera_net("geocalib", tmp_path / "gone.tar")
    assert capsys.readouterr().out == ""
