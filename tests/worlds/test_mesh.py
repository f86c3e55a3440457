"""Primitives are closed and turned outwards; meshes join without mixing up their surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from worlds.handmade import box, by_kind, first_met_from_behind, floor, rays_at

from sextant.worlds import street_objects
from sextant.worlds.mesh import Mesh, box_triangles, boxes, instances, limb, place, prism, quads
from sextant.worlds.scene import Scene
from sextant.worlds.surfaces import RED, Kind, surface_rows

metres = st.floats(0.1, 30.0)


def volume(triangles):
    """Signed volume, positive if turned outwards; a plane through the origin adds nothing."""
    a, b, c = np.moveaxis(np.asarray(triangles, float), -2, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6)


@given(metres, metres, metres, st.floats(-4, 4), st.floats(-50, 50))
def test_a_box_is_closed_outward_and_of_its_size(w, d, h, heading, x):
    triangles = box_triangles(
        np.array([[x, 2.0, -1.0]]), np.array([[w, d, h]]), np.array([heading]), bottom=True
    ).reshape(-1, 3, 3)
    assert len(triangles) == 12
    assert volume(triangles) == pytest.approx(w * d * h, rel=1e-6)
    assert triangles[..., 2].min() == pytest.approx(-1)
    names = {tuple(np.round(corner, 6)): i for i, corner in enumerate(triangles.reshape(-1, 3))}
    corners = [[names[tuple(np.round(corner, 6))] for corner in triangle] for triangle in triangles]
    edges = [(t[i], t[(i + 1) % 3]) for t in corners for i in range(3)]
    assert len(set(edges)) == len(edges) == 36
    assert all((b, a) in set(edges) for a, b in edges)  # every edge has its one neighbour, turned the same way


def test_without_a_bottom_a_box_is_that_without_two_triangles():
    arguments = np.zeros((1, 3)), np.ones((1, 3)), np.zeros(1)
    open_box, closed = box_triangles(*arguments), box_triangles(*arguments, bottom=True)
    assert np.array_equal(open_box, closed[:, :10])
    assert np.all(closed[:, 10:, :, 2] == 0)


@given(metres, st.just(0.0) | st.floats(0.01, 5.0), metres, st.integers(3, 16))
def test_a_prism_has_the_volume_of_its_frustum(r0, r1, height, sides):
    triangles = prism(r0, r1, height, sides)
    polygon = sides / 2 * np.sin(2 * np.pi / sides)  # area for radius 1
    assert volume(triangles) == pytest.approx(polygon * height * (r0 * r0 + r0 * r1 + r1 * r1) / 3, rel=1e-6)
    assert len(triangles) == (sides if r1 == 0 else 3 * sides)
    assert (
        np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1).min() > 0
    )


@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3))
def test_a_limb_is_a_prism_from_point_to_point(x, y, z):
    end = np.array([x, y, z + 4.0])
    triangles = limb(np.zeros(3), end, 0.2, 0.1, 6)
    assert volume(triangles) == pytest.approx(volume(prism(0.2, 0.1, float(np.linalg.norm(end)), 6)), rel=1e-9)
    assert np.abs(triangles.reshape(-1, 3) - end).sum(1).min() < 0.2


def test_placing_turns_counter_clockwise_then_moves():
    point = np.array([[[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]])
    placed = place(point, np.array([[10.0, 20, 30], [0, 0, 0]]), np.array([np.pi / 2, 0.0]))
    assert placed[0, 0] == pytest.approx(np.array([[10, 21, 30], [9, 20, 30], [10, 20, 31]]))
    assert placed[1, 0] == pytest.approx(point[0])


def test_quads_split_into_two_triangles_with_one_normal():
    a, b = quads(np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]))
    for t in (a, b):
        assert np.cross(t[1] - t[0], t[2] - t[0]).tolist() == [0, 0, 2]


def test_joining_renumbers_the_surfaces():
    parts = [box((i, 0, 0), (1, 1, 1), colour=(0.1 * i, 0, 0)) for i in range(4)]
    whole = Mesh.join([*parts[:2], Mesh.empty(), *parts[2:]])
    assert len(whole) == 48
    assert whole.surfaces[whole.surface, RED] == pytest.approx(np.repeat([0, 0.1, 0.2, 0.3], 12))
    assert np.array_equal(whole.triangles, np.concatenate([part.triangles for part in parts]))
    assert len(Mesh.join([])) == len(Mesh.join([Mesh.empty()])) == 0


def test_instances_may_share_rows():
    triangles = np.zeros((2, 3, 3, 3))
    rows = surface_rows(Kind.PLAIN, 2)
    assert instances(triangles, rows).surface.tolist() == [0, 0, 0, 1, 1, 1]
    chosen = np.array([[0, 1, 0], [1, 1, 0]])
    assert instances(triangles, rows, chosen).surface.tolist() == [0, 1, 0, 1, 1, 0]


def test_many_boxes_have_a_row_each():
    n = 5
    mesh = boxes(np.zeros((n, 3)), np.ones((n, 3)), np.zeros(n), surface_rows(Kind.WOOD, n))
    assert np.bincount(mesh.surface).tolist() == [10] * n


@pytest.mark.parametrize("fine", [True, False])
def test_cars_are_turned_outwards_wheels_included(fine):
    rng = np.random.default_rng(1)
    for seed in rng.random(12):
        mesh = street_objects.car_mesh(np.zeros((1, 3)), np.array([seed * 6]), np.array([seed]), fine=fine)
        assert len(first_met_from_behind(mesh, *rays_at(np.array([0, 0, 0.8]), 2.0, 4000, 2))) < 4  # under the car
        level = np.column_stack([np.zeros(200), np.zeros(200), np.linspace(0.3, 0.36, 200)])
        angle = np.linspace(0, 6, 200)
        way = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
        assert first_met_from_behind(mesh, level - 9 * way, way) == []  # at the height of the wheels


def test_people_lamps_and_benches_are_turned_outwards():
    at, heading = np.zeros((1, 3)), np.array([0.4])
    for seed in (0.05, 0.1, 0.2):
        mesh = street_objects.person_mesh(at, heading, np.array([seed]))
        assert first_met_from_behind(mesh, *rays_at(np.array([0, 0, 0.9]), 0.8, 4000, 3)) == []
    for mesh in (street_objects.lamp_mesh(at, heading, fine=True), street_objects.bench_mesh(at, heading)):
        assert len(first_met_from_behind(mesh, *rays_at(np.array([0, 0, 1.0]), 2.0, 4000, 4))) < 4
    lamp = street_objects.lamp_mesh(at, heading, fine=True)
    light = street_objects.lamp_lights(at, heading)[0]
    scene = Scene(Mesh.join([lamp, floor(20)]))
    assert scene.distance(light[None], np.array([[0, 0, -1.0]]))[0] == pytest.approx(light[2])  # below its own shade
    assert light[:2] == pytest.approx(street_objects.LAMP_REACH_M * np.array([np.cos(0.4), np.sin(0.4)]))


def test_signs_face_their_heading():
    for seed, style in ((0.1, 0), (0.5, 1), (0.9, 2)):
        mesh = street_objects.sign_mesh(np.zeros((1, 3)), np.array([0.0]), np.array([seed]))
        assert by_kind(mesh)["SIGN"] == (16, 3, 4)[style]
        scene = Scene(mesh)
        front = scene.hit(np.array([[5, 0.1, 2.6]]), np.array([[-1.0, 0, 0]]))
        assert scene.surfaces[scene.surface[front[0]], 0] == Kind.SIGN
