import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.handmade import box, floor, rectangle

from sextant.worlds import scene as scene_module
from sextant.worlds.mesh import Mesh, instances
from sextant.worlds.scene import MISS, Scene
from sextant.worlds.surfaces import Kind, surface_rows

BOX = Scene(box((0, 0, 0), (4, 2, 3)))
DOWN = np.array([[0, 0, -1.0]])


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@given(st.integers(0, 2**31))
def test_distances_to_a_box_are_those_of_the_slab_method(seed):
    rng = np.random.default_rng(seed)
    origins = unit(rng.normal(size=(200, 3))) * 9
    ways = unit(rng.uniform((-2, -1, 0), (2, 1, 3), (200, 3)) - origins)
    near = np.maximum.reduce([
        np.minimum((low - o) / d, (high - o) / d)
        for o, d, low, high in zip(origins.T, ways.T, (-2, -1, 0), (2, 1, 3), strict=True)
    ])  # fmt: skip
    assert BOX.distance(origins, ways) == pytest.approx(near, rel=1e-9)
    assert (BOX.hit(origins, ways) != MISS).all()
    assert BOX.distance(origins, -ways) == pytest.approx(np.full(200, np.inf))
    assert np.array_equal(BOX.blocked(origins, ways) == MISS, BOX.hit(origins, ways) == MISS)
    assert (BOX.blocked(origins, -ways) == MISS).all()


@pytest.mark.parametrize("away", [0.0, 3000.0])
def test_distances_are_exact_three_kilometres_from_the_origin(away):
    scene = Scene(floor(512, away, -away))
    rng = np.random.default_rng(0)
    origins = np.column_stack(
        [away + rng.uniform(-50, 50, 500), rng.uniform(-50, 50, 500) - away, rng.uniform(1, 9, 500)]
    )
    ways = unit(np.column_stack([rng.normal(size=(500, 2)), -rng.uniform(0.05, 2, 500)]))
    assert scene.distance(origins, ways) == pytest.approx(-origins[:, 2] / ways[:, 2], rel=1e-12)


def test_chunks_of_rays_change_nothing(monkeypatch):
    rng = np.random.default_rng(0)
    origins, ways = np.tile([9.0, 0, 1], (100, 1)), unit(rng.normal(size=(100, 3)) - [3, 0, 0])
    whole = BOX.distance(origins, ways)
    monkeypatch.setattr(scene_module, "CHUNK", 7)
    assert np.array_equal(BOX.distance(origins, ways), whole)
    assert np.isfinite(whole).any()


def test_inside_is_inside():
    rng = np.random.default_rng(0)
    points = rng.uniform(-4, 4, (2000, 3))
    within = (np.abs(points) < (2, 1, 3)).all(1) & (points[:, 2] > 0)
    clear = (np.abs(np.abs(points) - (2, 1, 3)) > 1e-3).all(1) & (np.abs(points[:, 2]) > 1e-3)
    assert 0.03 < within.mean() < 0.5
    assert np.array_equal(BOX.inside(points[clear]), within[clear])


def test_between_boxes_is_not_inside():
    ring = [box((6 * np.cos(a), 6 * np.sin(a), -1), (3, 3, 4), a) for a in np.arange(8) * np.pi / 4]
    scene = Scene(Mesh.join(ring))
    assert not scene.inside(np.zeros((1, 3)))[0]
    assert scene.inside(np.array([[6.0, 0, 1]]))[0]


def test_foliage_has_no_inside():
    solid = box((0, 0, 0), (2, 2, 2))
    for kind in (Kind.LEAVES, Kind.CONIFER):
        leaves = Mesh(solid.triangles, solid.surface, surface_rows(kind, 1, parameters=(1.0,)))
        assert not Scene(leaves).inside(np.array([[0, 0, 1.0]]))[0]
    assert Scene(solid).inside(np.array([[0, 0, 1.0]]))[0]


def test_triangles_without_area_are_left_out():
    sliver = instances(np.array([[[[0.0, 0, 5], [1, 1, 5], [2, 2, 5]]]]), surface_rows(Kind.LAMP, 1))
    scene = Scene(Mesh.join([sliver, floor(10, kind=Kind.ROAD)]))
    assert len(scene) == 2
    assert np.linalg.norm(scene.normals, axis=1) == pytest.approx([1, 1])
    hit = scene.hit(np.array([[1, 1, 9.0]]), DOWN)
    assert scene.surfaces[scene.surface[hit[0]], 0] == Kind.ROAD


def test_normals_offsets_and_bounds():
    scene = Scene(rectangle((0, 3, 1), (0, 5, 1), (0, 5, 4), (0, 3, 4)))
    assert scene.normals == pytest.approx(np.tile([1.0, 0, 0], (2, 1)))
    assert scene.offsets == pytest.approx([0, 0])
    assert scene.bounds.tolist() == [[0, 3, 1], [0, 5, 4]]


def test_no_ray_slips_through_a_shared_edge():
    n = 40
    x, y = np.meshgrid(np.linspace(-7, 7, n) ** 3, np.linspace(-7, 7, n) ** 3, indexing="ij")
    p = np.stack([x, y, np.sin(x) + np.cos(3 * y)], -1)
    cells = np.stack([p[:-1, :-1], p[1:, :-1], p[1:, 1:], p[:-1, 1:]], 2).reshape(-1, 4, 3)
    mesh = instances(np.concatenate([cells[:, [0, 1, 2]], cells[:, [0, 2, 3]]])[None], surface_rows(Kind.PLAIN, 1))
    rng = np.random.default_rng(0)
    triangle, k, share = rng.integers(0, len(mesh), 40_000), rng.integers(0, 3, 40_000), rng.random((40_000, 1))
    corners = mesh.triangles.astype(float)
    on_edges = corners[triangle, k] * (1 - share) + corners[triangle, (k + 1) % 3] * share
    on_edges = on_edges[(np.abs(on_edges[:, :2]) < 300).all(1)]
    eye = np.tile([1.234, -2.345, 300.0], (len(on_edges), 1))
    missed = [(Scene(mesh, watertight=w).hit(eye, unit(on_edges - eye)) == MISS).sum() for w in (True, False)]
    assert missed[0] == 0
    assert missed[1] > 100  # the rays do go along the edges
