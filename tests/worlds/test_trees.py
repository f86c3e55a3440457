import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.handmade import by_kind

from sextant.worlds.surfaces import KIND, P0, Kind, X, Z
from sextant.worlds.trees import Trees, tree_mesh


def wood(count, conifers=0, size=1.0, seed=0):
    rng = np.random.default_rng(seed)
    conifer = np.arange(count) < conifers
    place = np.column_stack([np.arange(count) * 30.0, np.zeros(count), np.full(count, 0.12)])
    return Trees(place, rng.uniform(0, 6, count), np.full(count, size), conifer, rng.random(count))


@given(st.floats(0, 1), st.sampled_from([70, 300]))
def test_foliage_is_the_share_of_leaves(foliage, leaves):
    counts = by_kind(tree_mesh(wood(5), foliage, leaves))
    assert counts.get("LEAVES", 0) == 5 * round(foliage * leaves)
    assert counts["BARK"] == by_kind(tree_mesh(wood(5), 0.0, leaves))["BARK"]


def test_conifers_keep_their_needles():
    trees = wood(4, conifers=4)
    assert np.array_equal(tree_mesh(trees, 0.0, 70).triangles, tree_mesh(trees, 1.0, 70).triangles)
    assert set(by_kind(tree_mesh(trees, 0.0, 70))) == {"CONIFER", "BARK"}


@pytest.mark.parametrize("size", [0.5, 1.0, 1.5])
def test_trees_stand_on_the_ground_and_grow_with_their_size(size):
    mesh = tree_mesh(wood(12, conifers=3, size=size), 1.0, 300)
    z = mesh.triangles[..., 2]
    assert z.min() == pytest.approx(0.12, abs=0.1 * size)
    assert 7 * size < z.max() < 13 * size
    place = mesh.surfaces[mesh.surface, X]
    assert np.abs(mesh.triangles[..., 0].mean(1) - place).max() < 6 * size
    assert np.isfinite(mesh.triangles).all()


def test_every_tree_has_its_own_crown():
    mesh = tree_mesh(wood(8), 1.0, 70)
    rows = mesh.surfaces[mesh.surfaces[:, KIND] == Kind.LEAVES]
    assert sorted(rows[:, X].tolist()) == pytest.approx((np.arange(8) * 30.0).tolist())
    assert (rows[:, P0] > 1).all()
    for number in np.flatnonzero(mesh.surfaces[:, KIND] == Kind.LEAVES):
        leaves = mesh.triangles[mesh.surface == number].mean(1)
        from_centre = np.linalg.norm(leaves - mesh.surfaces[number, X : Z + 1], axis=1)
        assert np.mean(from_centre < 1.1 * mesh.surfaces[number, P0]) > 0.9
    assert (
        len(
            {
                tuple(np.round(mesh.triangles[mesh.surface == n][0].ravel() - mesh.surfaces[n, X], 2))
                for n in range(0, 8)
            }
        )
        > 4
    )


def test_no_trees_are_an_empty_mesh():
    assert len(tree_mesh(wood(0), 1.0, 70)) == 0
