"""Learned whitening: against scipy's eigenproblem, its invariances, and what it is for."""

import numpy as np
import pytest
import torch
from scipy.linalg import eigh

from sextant.models.learned_whitening import learned_whitening


def whitened(features: torch.Tensor, dimension: int, **options: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Of features (places, conditions, d)."""
    places, conditions, _ = features.shape
    return learned_whitening(
        features.flatten(0, 1), torch.arange(places).repeat_interleave(conditions), dimension, **options
    )


def world(places: int, conditions: int, size: int, seed: int = 0) -> torch.Tensor:
    """Places in some directions, and nuisance, larger, in others."""
    rng = np.random.default_rng(seed)
    place, nuisance = rng.normal(size=(2, 5, size))
    x = rng.normal(size=(places, 1, 5)) @ place + 4 * rng.normal(size=(places, conditions, 5)) @ nuisance
    return torch.from_numpy(x + 0.5 * rng.normal(size=x.shape) + 3).float()


@pytest.mark.parametrize("size", [12, 400])
def test_it_solves_the_problem_of_its_docstring(size: int) -> None:
    """More images than features, and fewer; every principal component is kept."""
    features, shrinkage = world(60, 3, size), 0.5
    weight, bias = whitened(features, 4, components=1000, shrinkage=shrinkage)
    x = features.double().numpy()
    x = x - x.mean((0, 1))
    _, _, axes = np.linalg.svd(x.reshape(-1, size), full_matrices=False)
    axes = axes[: min(size, 179)]
    y = x @ axes.T
    within = np.einsum("gci,gcj->ij", *(y - y.mean(1, keepdims=True),) * 2) / (60 * 3)
    between = y.mean(1).T @ y.mean(1) / 60
    _, vectors = eigh(between, within + shrinkage * np.trace(within) / len(within) * np.eye(len(within)))
    ours = (features @ weight.T + bias).double().numpy()
    expected = y @ vectors[:, ::-1][:, :4]
    signs = np.sign((ours * expected).sum((0, 1)))
    np.testing.assert_allclose(ours, expected * signs, atol=2e-3 * np.abs(expected).max())


def test_it_finds_places_among_nuisance() -> None:
    """Under nuisance that outweighs the places, on places that it has not seen."""
    features = world(400, 2, 64)
    weight, bias = whitened(features[:200], 5, components=32, shrinkage=0.01)

    def hits(x: torch.Tensor) -> float:
        x = torch.nn.functional.normalize(x, dim=-1)
        return float(((x[:, 1] @ x[:, 0].T).argmax(1) == torch.arange(len(x))).float().mean())

    assert hits(features[200:] - features.mean((0, 1))) < 0.5
    assert hits(features[200:] @ weight.T + bias) > 0.8


def test_a_shift_of_all_features_changes_nothing() -> None:
    """Only the bias knows where they are."""
    features = world(50, 2, 20).double().round(decimals=3).float()
    first, _ = whitened(features, 3, components=10)
    weight, bias = whitened(features + 2, 3, components=10)
    a, b = features @ weight.T, features @ first.T
    torch.testing.assert_close((a - a.mean((0, 1))).abs(), (b - b.mean((0, 1))).abs(), atol=1e-2, rtol=1e-2)
    outputs = (features + 2) @ weight.T + bias
    torch.testing.assert_close(outputs.mean((0, 1)), torch.zeros(3), atol=1e-3, rtol=0)


def test_what_it_cannot_do() -> None:
    """One condition, too many dimensions, no shrinkage."""
    with pytest.raises(ValueError, match="two or more images"):
        whitened(world(10, 1, 8), 3)
    with pytest.raises(ValueError, match="shrinkage"):
        whitened(world(10, 2, 8), 3, shrinkage=0)
    with pytest.raises(ValueError, match="9 are needed"):
        whitened(world(10, 2, 8), 9)
    with pytest.raises(ValueError, match=r"2 components .* 3 are needed"):
        whitened(world(10, 2, 8), 3, components=2)
    with pytest.raises(ValueError, match="of no place differ"):
        whitened(world(10, 1, 8).expand(-1, 2, -1), 3)


def test_a_dead_channel_leaves_the_last_row_empty() -> None:
    """The features vary in one direction less than numbers come out."""
    features = world(40, 2, 8)
    dead = torch.cat([features[..., :5], torch.zeros(40, 2, 1), features[..., 5:]], dim=2)
    weight, bias = whitened(dead, 9)
    assert weight.shape == (9, 9)
    assert not weight[8].any()
    assert bias[8] == 0
    alive, _ = whitened(features, 8)
    torch.testing.assert_close((dead @ weight.T)[..., :8].abs(), (features @ alive.T).abs(), atol=1e-3, rtol=1e-3)
