"""Poolings: what each is invariant to, limits, and loops as oracles."""

import math

import pytest
import torch
from sklearn.cluster import KMeans

from sextant.models.pooling import Average, CellsAndVLAD, FeatureMixer, Flatten, GeM, NetVLAD, generalised_mean

CHANNELS, SIZE = 6, (3, 4)


def features(seed=0, count=2, dtype=torch.float32):
    return torch.randn(count, CHANNELS, *SIZE, generator=torch.Generator().manual_seed(seed), dtype=dtype)


def made(cls, **settings):
    torch.manual_seed(0)
    return cls(CHANNELS, SIZE, **settings)


@pytest.fixture(
    params=[
        (Flatten, {}),
        (Flatten, {"grid": (2, 2)}),
        (Average, {}),
        (GeM, {}),
        (NetVLAD, {"clusters": 5}),
        (CellsAndVLAD, {"clusters": 5, "grid": (2, 2)}),
        (FeatureMixer, {"out_channels": 5, "out_rows": 2, "depth": 2}),
    ],
    ids=lambda case: case[0].__name__ + "_".join(case[1]),
)
def pooling(request):
    cls, settings = request.param
    return made(cls, **settings)


def test_it_gives_as_many_numbers_as_it_says_of_each_image_alone(pooling):
    x = features(count=3)
    together = pooling(x)
    assert together.shape == (3, pooling.features)
    torch.testing.assert_close(pooling(x[1:2]), together[1:2])
    torch.testing.assert_close(pooling(x.contiguous(memory_format=torch.channels_last)), together)


def test_gradients_are_those_of_finite_differences(pooling):
    x = (features(dtype=torch.float64).abs() + 0.1).requires_grad_()  # away from the corner of GeM
    parameters = {name: p.detach().double().requires_grad_() for name, p in pooling.named_parameters()}
    names = list(parameters)

    def run(x, *values):
        return torch.func.functional_call(pooling, dict(zip(names, values, strict=True)), (x,))

    assert torch.autograd.gradcheck(run, (x, *parameters.values()), atol=1e-4)


@pytest.mark.parametrize(("cls", "settings"), [(Average, {}), (GeM, {}), (NetVLAD, {"clusters": 5})])
def test_poolings_without_order_do_not_know_where_a_cell_is(cls, settings):
    x, order = features(), torch.randperm(12)
    shuffled = x.flatten(2)[..., order].reshape(x.shape)
    pool = made(cls, **settings)
    torch.testing.assert_close(pool(shuffled), pool(x))


def test_flatten_keeps_every_cell_or_the_means_of_a_grid():
    x = features()
    assert torch.equal(made(Flatten)(x), x.reshape(2, -1))
    coarse = Flatten(6, (4, 4), grid=(2, 1))
    y = torch.randn(1, 6, 4, 4)
    expected = torch.stack([y[:, :, :2].mean((2, 3)), y[:, :, 2:].mean((2, 3))], 2).flatten(1)
    torch.testing.assert_close(coarse(y), expected)
    with pytest.raises(ValueError, match="5x1"):
        made(Flatten, grid=(5, 1))


def test_gem_goes_from_the_mean_to_the_maximum():
    x = features().abs() + 0.01
    torch.testing.assert_close(generalised_mean(x, 1.0), x.mean((2, 3)))
    torch.testing.assert_close(generalised_mean(x, 300.0), x.amax((2, 3)), rtol=0.01, atol=0)
    torch.testing.assert_close(generalised_mean(x, 3.0), x.pow(3).mean((2, 3)).pow(1 / 3))
    torch.testing.assert_close(generalised_mean(1e12 * x, 12.0), 1e12 * generalised_mean(x, 12.0))


def test_gem_is_finite_for_dead_and_negative_features_and_for_any_p_that_training_makes():
    pool = made(GeM)
    for p in (-5.0, 0.0, 1e4):
        with torch.no_grad():
            pool.p.fill_(p)
        x = torch.stack([torch.zeros(CHANNELS, *SIZE), -torch.ones(CHANNELS, *SIZE), features()[0]]).requires_grad_()
        pool.p.grad = None
        pool(x).sum().backward()
        assert x.grad.isfinite().all()
        assert pool.p.grad.isfinite()
        assert pool.p.grad != 0
    assert "p" not in dict(made(GeM, train_p=False).named_parameters()) or not made(GeM, train_p=False).p.requires_grad


def test_gem_may_be_run_twice_before_one_backward():
    pool = made(GeM)
    (pool(features(0)) - pool(features(1))).square().sum().backward()
    assert pool.p.grad is not None


def vlad_by_loops(pool, x):
    out = []
    for image in x:
        cells = [cell / cell.norm() for cell in image.flatten(1).T]
        rows = torch.zeros(len(pool.centres), CHANNELS)
        for cell in cells:
            weights = [math.exp(score) for score in pool.assignment(cell).tolist()]
            for k, weight in enumerate(weights):
                rows[k] += weight / sum(weights) * (cell - pool.centres[k].detach())
        rows = rows / rows.norm(dim=1, keepdim=True)
        out.append(rows.flatten() / rows.norm())
    return torch.stack(out)


@pytest.mark.parametrize("initialised", [False, True])
def test_netvlad_is_its_equation(initialised):
    pool = made(NetVLAD, clusters=4)
    if initialised:
        pool.initialise(features(5, 20).permute(0, 2, 3, 1).reshape(-1, CHANNELS))
    x = features()
    with torch.no_grad():
        torch.testing.assert_close(pool(x), vlad_by_loops(pool, x), atol=1e-5, rtol=1e-4)


def test_cells_stand_beside_netvlad_with_their_weight():
    both, x = made(CellsAndVLAD, clusters=4, grid=(2, 2), cells=0.5), features()
    with torch.no_grad():
        found = both(x)
        means = torch.nn.functional.adaptive_avg_pool2d(x, (2, 2)).flatten(1)
        torch.testing.assert_close(found[:, : 4 * CHANNELS], vlad_by_loops(both, x), atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(found[:, 4 * CHANNELS :], 0.5 * means / means.norm(dim=1, keepdim=True))
    assert found.shape[1] == both.features


def test_netvlad_starts_at_the_centres_of_k_means_and_assigns_by_distance():
    generator = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(4, CHANNELS, generator=generator), dim=1)
    blobs = directions.repeat_interleave(50, 0) + 0.02 * torch.randn(200, CHANNELS, generator=generator)
    blobs *= torch.rand(200, 1, generator=generator) + 0.5  # lengths do not matter
    pool = made(NetVLAD, clusters=4)
    alpha = pool.initialise(blobs, seed=1)
    near = torch.cdist(directions, pool.centres.detach()).min(1)
    assert near.values.max() < 0.05
    assert sorted(near.indices.tolist()) == [0, 1, 2, 3]
    unit = torch.nn.functional.normalize(blobs, dim=1)
    squared = torch.cdist(unit, pool.centres.detach()).square()
    torch.testing.assert_close(pool.assignment(unit).softmax(1), (-alpha * squared).softmax(1), atol=1e-4, rtol=1e-4)
    best, second = squared.topk(2, largest=False).values.unbind(1)
    assert float((alpha * (second - best)).mean()) == pytest.approx(math.log(100), rel=1e-4)
    oracle = KMeans(4, n_init=5, random_state=0).fit(unit.numpy()).inertia_
    assert float(squared.min(1).values.sum()) == pytest.approx(oracle, rel=1e-3)


def test_netvlad_starts_the_same_from_one_seed_and_from_equal_features():
    x = features(5, 20).permute(0, 2, 3, 1).reshape(-1, CHANNELS)
    first, second = made(NetVLAD), made(NetVLAD)
    assert first.initialise(x, 3) == second.initialise(x, 3)
    assert torch.equal(first.centres, second.centres)
    flat = made(NetVLAD, clusters=3)
    flat.initialise(torch.ones(10, CHANNELS))
    assert flat(features()).isfinite().all()


def test_a_feature_mixer_is_its_equations():
    pool = made(FeatureMixer, out_channels=5, out_rows=2, depth=2, ratio=0.5)
    for parameter in pool.parameters():
        torch.nn.init.normal_(parameter, std=0.5)
    x = features()
    with torch.no_grad():
        mixed = x.reshape(2, CHANNELS, 12)
        for block in pool.mix:
            norm = (mixed - mixed.mean(2, keepdim=True)) / (mixed.var(2, correction=0, keepdim=True) + 1e-5).sqrt()
            norm = norm * block.norm.weight + block.norm.bias
            hidden = (torch.einsum("hn,bcn->bch", block.widen.weight, norm) + block.widen.bias).clamp(min=0)
            assert hidden.shape[2] == 6
            mixed = mixed + torch.einsum("nh,bch->bcn", block.narrow.weight, hidden) + block.narrow.bias
        z = torch.einsum("dc,bcn->bdn", pool.project_channels.weight, mixed) + pool.project_channels.bias[:, None]
        o = torch.einsum("rn,bdn->bdr", pool.project_cells.weight, z) + pool.project_cells.bias
        o = o.flatten(1)
        torch.testing.assert_close(pool(x), o / o.norm(dim=1, keepdim=True))


def test_features_that_cannot_start_a_netvlad_are_refused():
    pool = made(NetVLAD, clusters=4)
    for wrong in (torch.randn(3, CHANNELS), torch.randn(9, CHANNELS + 1)):
        with pytest.raises(ValueError, match="4 centres"):
            pool.initialise(wrong)
    with pytest.raises(ValueError, match="finite"):
        pool.initialise(torch.full((9, CHANNELS), torch.nan))
