import numpy as np
import pytest

from sextant.worlds.surfaces import (
    BLUE,
    COLUMNS,
    COS,
    KIND,
    P0,
    RED,
    SEED,
    SIN,
    Kind,
    X,
    Z,
    linear,
    palette,
    surface_rows,
)


@pytest.mark.parametrize(
    ("colour", "value"), [("#000000", 0.0), ("#ffffff", 1.0), ("#808080", 0.2158605), ("#0a0a0a", 10 / 255 / 12.92)]
)
def test_colours_are_decoded_by_the_srgb_curve(colour, value):
    assert linear(colour) == pytest.approx((value,) * 3, abs=1e-6)


def test_a_palette_keeps_order_and_channels():
    table = palette("#ff0000", "#00ff00", "#0000ff")
    assert np.array_equal(table, np.eye(3))


def test_rows_take_one_value_for_all_or_one_each():
    rows = surface_rows(
        Kind.FACADE, 3, seed=[0.1, 0.2, 0.3], colour=(0.1, 0.5, 0.9), second=np.eye(3), origin=(1, 2, 3),
        heading=np.array([0.0, np.pi / 2, np.pi]), parameters=(7.0, [1.0, 2.0, 3.0]),
    )  # fmt: skip
    assert rows.shape == (3, COLUMNS)
    assert rows.dtype == np.float32
    assert (rows[:, KIND] == Kind.FACADE).all()
    assert rows[:, SEED] == pytest.approx([0.1, 0.2, 0.3])
    assert rows[1, RED : BLUE + 1] == pytest.approx([0.1, 0.5, 0.9])
    assert np.array_equal(rows[:, X : Z + 1], np.tile([1, 2, 3], (3, 1)))
    assert rows[:, COS] == pytest.approx([1, 0, -1], abs=1e-7)
    assert rows[:, SIN] == pytest.approx([0, 1, 0], abs=1e-7)
    assert rows[:, P0].tolist() == [7, 7, 7]
    assert rows[:, P0 + 1].tolist() == [1, 2, 3]
    assert not rows[:, P0 + 2 :].any()


def test_kinds_are_numbered_without_gaps():
    assert [int(kind) for kind in Kind] == list(range(len(Kind)))
