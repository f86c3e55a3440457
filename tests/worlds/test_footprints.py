import numpy as np
import pytest
import shapely
from shapely import Point, Polygon, affinity, box
from worlds.handmade import down, first_met_from_behind, pinhole, rays_at

from sextant.worlds.appearance import Appearance
from sextant.worlds.blocks import KERB_M, Ground
from sextant.worlds.building_design import FLAT
from sextant.worlds.buildings import building_mesh
from sextant.worlds.footprints import Footprint, fit_footprints, houses_on
from sextant.worlds.scene import Scene
from sextant.worlds.street_layouts import grid_streets
from sextant.worlds.surfaces import KIND, Kind
from sextant.worlds.town import Town

GRAPH = grid_streets(2, 1, 100.0)
GROUND = Ground(GRAPH)
L_SHAPE = Polygon([(20, 20), (60, 20), (60, 35), (35, 35), (35, 60), (20, 60)])
COURTYARD = Polygon(box(120, 20, 180, 80).exterior, [box(140, 40, 160, 60).exterior])
HOUSE = affinity.rotate(box(70, 60, 84, 70), 20)


def built(*footprints, seed=0):
    return houses_on(footprints, GROUND, 0.6, np.random.default_rng(seed))


def test_buildings_stand_where_the_polygons_are_and_nowhere_else():
    footprints = [Footprint(L_SHAPE, storeys=4), Footprint(COURTYARD, height_m=20.0), Footprint(HOUSE, storeys=2)]
    town = Town(GRAPH, 1, detail="coarse", footprints=footprints)
    for outline, given in zip(town.outlines, footprints, strict=True):
        assert shapely.area(outline ^ given.outline) < 0.01 * given.outline.area
    rng = np.random.default_rng(0)
    points = rng.uniform((5, 5), (195, 95), (4000, 2))
    scene = town.renderer(Appearance(foliage_density=0.0)).scene
    hit = scene.hit(np.column_stack([points, np.full(len(points), 300.0)]), np.tile([0.0, 0, -1], (len(points), 1)))
    on_roof = np.isin(scene.surfaces[scene.surface[hit], KIND], [Kind.ROOF, Kind.PLAIN, Kind.FACADE])
    inside = shapely.contains_xy(shapely.union_all([each.outline.buffer(-0.3) for each in footprints]), *points.T)
    apart = ~shapely.contains_xy(shapely.union_all([each.outline.buffer(1.0) for each in footprints]), *points.T)
    assert on_roof[inside].all()
    assert inside.sum() > 500
    assert on_roof[apart].mean() < 0.05  # lamps, signs, benches and cars
    assert not on_roof[shapely.contains_xy(box(142, 42, 158, 58), *points.T)].any()


def test_what_does_not_stand_takes_no_ground_from_others():
    over_the_street, beneath, in_a_garden = box(80, 10, 120, 60), box(110, 20, 118, 30), box(20, 20, 30, 30)
    outlines = [over_the_street, beneath, in_a_garden, box(19, 19, 40, 40)]
    found = fit_footprints([Footprint(each) for each in outlines], GROUND)
    assert found[0] is None
    assert found[1] is not None
    assert found[2] is None  # within the larger one, which stands
    assert found[3].outline.area == pytest.approx(21 * 21, rel=0.01)


@pytest.mark.parametrize("shape", [L_SHAPE, COURTYARD])
def test_a_shaped_building_has_no_holes(shape):
    buildings, shapes = built(Footprint(shape, height_m=12.0))
    mesh = building_mesh(buildings, np.array([False]), 0, shapes=shapes)
    middle = np.array([shape.centroid.x, shape.centroid.y, 6.0])
    assert first_met_from_behind(mesh, *rays_at(middle, 45.0, 20_000, 0)) == []
    inner = shape.representative_point()
    assert Scene(mesh).inside(np.array([[inner.x, inner.y, 3.0]]))[0]
    assert mesh.triangles[..., 2].max() == pytest.approx(12.0 + KERB_M)


def test_heights_are_those_given_and_others_as_the_neighbours():
    far, near = box(170, 20, 180, 30), box(86, 76, 94, 84)
    buildings, _ = built(
        Footprint(L_SHAPE, height_m=30.0),
        Footprint(far, storeys=1),
        Footprint(near),
        Footprint(HOUSE, height_m=9.0, storeys=2),
    )
    assert buildings.storeys.tolist() == [10, 1, 2, 2]
    assert buildings.size[0, 2] == 30
    assert buildings.size[[1, 2], 2].tolist() == [3, 6]
    assert buildings.size[3, 2] + buildings.rise[3] == pytest.approx(9)
    assert built(Footprint(HOUSE))[0].storeys[0] >= 1


def test_rectangles_face_their_street_and_neighbours_adjoin():
    left, right = box(20, 10, 30, 22), box(30, 10, 40, 22)
    buildings, shapes = built(
        Footprint(left, storeys=2), Footprint(right, storeys=2), Footprint(box(20, 78, 32, 90), storeys=1)
    )
    assert shapes == {}
    assert buildings.heading[:2] == pytest.approx(0)  # the street is south of them
    assert abs(buildings.heading[2]) == pytest.approx(np.pi)
    assert buildings.attached.tolist() == [[False, True], [True, False], [False, False]]
    assert buildings.size[:, :2].tolist() == [[10, 12], [10, 12], [12, 12]]


def test_wide_and_tall_buildings_have_flat_roofs():
    buildings, _ = built(Footprint(box(20, 20, 60, 50), storeys=1), Footprint(box(70, 20, 80, 30), storeys=8))
    assert buildings.roof.tolist() == [FLAT, FLAT]


def test_footprints_are_cut_back_to_pavements_and_left_out_in_streets():
    on_pavement, in_street, inside, scrap = (
        box(20, 5, 40, 25),
        box(90, 40, 110, 60),
        box(25, 15, 30, 20),
        box(60, 60, 62, 62),
    )
    bow_tie = Polygon([(60, 20), (80, 40), (80, 20), (60, 40)])
    fitted = fit_footprints([Footprint(each) for each in (on_pavement, in_street, inside, scrap, bow_tie)], GROUND)
    assert [each is None for each in fitted] == [False, True, True, True, False]
    assert fitted[0].outline.bounds == pytest.approx((20, 7.4, 40, 25), abs=0.11)
    assert fitted[4].outline.area == pytest.approx(100, rel=0.01)


def test_overlapping_footprints_share_the_ground():
    fitted = fit_footprints(
        [Footprint(box(20, 20, 40, 40)), Footprint(box(35, 20, 50, 40)), Footprint(box(20, 20, 40, 40))], GROUND
    )
    kept = [each.outline for each in fitted if each]
    assert len(kept) == 2
    assert shapely.intersection(*kept).area < 1e-9
    assert shapely.union_all(kept).area == pytest.approx(600)


def test_a_town_may_have_no_building():
    town = Town(GRAPH, 1, detail="coarse", footprints=[])
    assert len(town.buildings) == 0
    assert town.outlines == []
    picture = town.renderer(Appearance()).pictures(pinhole(16, 12, 70), down(50, 50, 80)[None], Appearance())
    assert picture.std() > 0


def test_things_keep_out_of_footprints():
    town = Town(GRAPH, 1, detail="coarse", footprints=[Footprint(L_SHAPE), Footprint(COURTYARD), Footprint(HOUSE)])
    for x, y, _ in town.trees.position:
        assert min(Point(x, y).distance(outline) for outline in town.outlines) > 1.5
