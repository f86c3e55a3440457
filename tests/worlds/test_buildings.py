import numpy as np
import pytest
import shapely
from worlds.handmade import by_kind, first_met_from_behind, rays_at, small_town

from sextant.worlds.appearance import Appearance
from sextant.worlds.buildings import FLAT, GABLE, HIP, MANSARD, Buildings, building_mesh, design, footprints
from sextant.worlds.scene import Scene
from sextant.worlds.shading.facade import FRENCH, HOME, OFFICE, SHOP, SQUARE
from sextant.worlds.surfaces import P0


def house(roof, *, attached=(False, False), across=False, use=HOME, window=SQUARE):
    def row(*values):
        return np.array([values], float)

    return Buildings(
        row(2, -3, 0.12), np.array([0.3]), row(10, 9, 6.5), np.array([roof]), np.array([2.6 if roof else 0.0]),
        np.array([across]), np.array([2]), np.array([3.2]), np.array([use]), np.array([window]), np.array([0]),
        np.array([attached]), np.array([0.4]),
    )  # fmt: skip


def drawn(count=400, density=None, seed=0):
    rng = np.random.default_rng(seed)
    density = rng.random(count) if density is None else np.full(count, density)
    plots = rng.uniform((7.5, 6.5), (15, 14), (count, 2))
    terraced = density > 0.5
    joined = np.repeat((terraced & (rng.random(count) < 0.5))[:, None], 2, 1)
    place = np.column_stack([np.arange(count) * 40.0, np.zeros(count), np.zeros(count)])
    return design(place, rng.uniform(-3, 3, count), plots, density, joined, terraced, rng)


def areas(mesh):
    corners = mesh.triangles.astype(float)
    sides = np.linalg.norm(np.roll(corners, -1, 1) - corners, axis=2).max(1)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / sides


@pytest.mark.parametrize("across", [False, True])
@pytest.mark.parametrize("attached", [(False, False), (True, False)])
@pytest.mark.parametrize("roof", [FLAT, GABLE, HIP, MANSARD])
def test_a_house_has_no_holes(roof, attached, across):
    mesh = building_mesh(house(roof, attached=attached, across=across), np.array([False]), 0)
    rays = rays_at(np.array([2, -3, 5.0]), 7.0, 20_000, roof)
    behind = first_met_from_behind(mesh, *rays)
    assert behind == [] or (roof in (GABLE, HIP) and len(behind) < 60)  # there the underside of the eaves
    assert "FACADE" not in behind
    assert (areas(mesh) > 1e-3).all()
    assert Scene(mesh).inside(np.array([[2, -3, 3.0]]))[0]
    assert not Scene(mesh).inside(np.array([[2, -13, 3.0]]))[0]


@pytest.mark.parametrize("use", [HOME, SHOP, OFFICE])
def test_shops_and_balconies_stand_out_of_the_wall(use):
    plain = building_mesh(house(FLAT), np.array([False]), 0)
    rich = building_mesh(house(FLAT, use=use, window=FRENCH), np.array([False]), 0)
    assert len(rich) > len(plain)
    coarse = building_mesh(house(FLAT, use=use, window=FRENCH), np.array([False]), 0, fine=False)
    assert len(coarse) < len(rich)


def test_facades_know_their_width_and_height():
    mesh = building_mesh(house(FLAT), np.array([False]), 0)
    assert np.sort(mesh.surfaces[:4, P0]).tolist() == [9, 9, 10, 10]
    assert mesh.surfaces[:4, P0 + 1].tolist() == [6.5] * 4
    assert mesh.triangles[mesh.surface < 4][..., 2].max() == pytest.approx(6.62)


def test_walls_to_a_neighbour_are_blank():
    mesh = building_mesh(house(FLAT, attached=(True, False)), np.array([False]), 0)
    assert mesh.surfaces[:4, P0 + 8].tolist() == [0, 0, 0, 1]


def test_density_makes_houses_tall_and_full_of_shops():
    village, city = drawn(density=0.1), drawn(density=0.9)
    assert city.storeys.mean() > 2 * village.storeys.mean()
    assert (city.use == SHOP).mean() > 0.3 > (village.use == SHOP).mean()
    assert (village.use != OFFICE).all()
    assert village.storeys.min() >= 1
    assert (city.size[:, 2] >= 2.5 * city.storeys).all()
    assert not city.across[drawn(density=0.9).attached.any(1)].any()


def test_all_that_is_drawn_is_solid():
    b = drawn()
    mesh = building_mesh(b, np.zeros(len(b), bool), 0)
    assert np.isfinite(mesh.triangles).all()
    assert np.isfinite(mesh.surfaces).all()
    assert (areas(mesh) > 5e-4).all()
    assert mesh.surfaces[:, 2:8].min() >= 0
    assert mesh.surfaces[:, 2:8].max() <= 1.2
    assert {"FACADE", "ROOF", "PLAIN", "AWNING", "FENCE"} <= set(by_kind(mesh))
    assert (
        len(
            building_mesh(
                design(
                    *(np.zeros((0, *s)) for s in ((3,), (), (2,), ())),
                    np.zeros((0, 2), bool),
                    np.zeros(0, bool),
                    np.random.default_rng(0),
                ),
                np.zeros(0, bool),
                0,
            )
        )
        == 0
    )


def test_repainting_changes_the_paint_and_not_the_walls():
    b = drawn(60)
    half = np.arange(60) < 30
    before, after = (building_mesh(b, repaint, 5) for repaint in (np.zeros(60, bool), half))
    walls = slice(0, 60)
    assert np.array_equal(before.triangles[:120], after.triangles[:120])
    same = (before.surfaces[walls, 2:5] == after.surfaces[walls, 2:5]).all(1)
    assert np.array_equal(same, ~half)
    other = building_mesh(b, half, 6)
    assert not np.array_equal(other.surfaces[:30], after.surfaces[:30])


def test_footprints_are_the_walls_seen_from_above():
    b = small_town().buildings
    outlines = shapely.polygons(footprints(b).astype(float))
    assert shapely.area(outlines) == pytest.approx(b.size[:, 0] * b.size[:, 1], rel=1e-4)
    assert shapely.is_ccw(shapely.get_exterior_ring(outlines)).all()
    mesh = small_town().mesh(Appearance())
    corners = mesh.triangles[mesh.surfaces[mesh.surface, 0] == 1][:, :, :2].reshape(-1, 2)
    near = shapely.distance(shapely.union_all(outlines), shapely.points(corners.astype(float)))
    assert np.quantile(near, 0.9) < 0.01
