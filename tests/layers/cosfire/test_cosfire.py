"""COSFIRE against loops in numpy over images, filters, moves and parts, and what must hold of any filter."""

import copy
import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from layers.cosfire.cosfire_cases import MEANS, layers, plain_responses, random_images, with_parts

from sextant.errors import UserError
from sextant.layers.cosfire import Blur, Cosfire, DoGBank, GaborBank, Tolerance, preset

seeds = st.integers(0, 99)


@pytest.mark.slow
@given(layers(means=MEANS), seeds)
@settings(max_examples=60)
def test_responses_are_those_of_loops_over_everything(case, seed):
    layer, filters = case
    images = random_images(seed, 2, 1, 13, 10)
    np.testing.assert_allclose(layer(images), plain_responses(layer, filters, images), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(layers(shift="bilinear", means=MEANS), seeds)
def test_responses_between_pixels_are_those_of_loops_over_everything(case, seed):
    layer, filters = case
    images = random_images(seed, 2, 1, 9, 12)
    np.testing.assert_allclose(layer(images), plain_responses(layer, filters, images), rtol=1e-9, atol=1e-12)


@pytest.mark.slow
@given(layers(), seeds)
def test_in_single_precision_they_are_the_same_up_to_its_rounding(case, seed):
    layer, _ = case
    layer.t1 = layer.t3 = 0.0  # rounding may carry a value over a threshold,
    layer.floor = 0.05  # and the root of what it leaves of nothing is much
    images = random_images(seed, 2, 1, 13, 10)
    single = layer(images.float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), layer(images), rtol=1e-3, atol=1e-6)


@pytest.mark.slow
@given(layers(means=MEANS), seeds, st.sampled_from([torch.float32, torch.float64]))
def test_maxima_are_the_largest_responses(case, seed, dtype):
    layer, _ = case
    images = random_images(seed, 3, 1, 13, 10, dtype=dtype)
    expected = layer(images).amax((2, 3))
    torch.testing.assert_close(layer.maxima(images), expected, rtol=1e-5 if dtype == torch.float32 else 1e-12, atol=0)


@pytest.mark.slow
@given(layers(), seeds, st.integers(1, 4))
def test_the_loop_of_the_processor_is_the_way_that_has_gradients(case, seed, tiles):
    layer, _ = case
    images = random_images(seed, 2, 1, 13, 10)
    with_gradients = layer.maxima(images.clone().requires_grad_(), tiles)
    assert with_gradients.requires_grad
    torch.testing.assert_close(layer.maxima(images, tiles), with_gradients.detach(), rtol=1e-11, atol=0)


@pytest.mark.slow
@given(layers(means=MEANS), seeds)
def test_maxima_of_tiles_are_those_of_parts_of_the_responses(case, seed):
    layer, _ = case
    images = random_images(seed, 3, 1, 12, 10)
    quarters = [rows for half in layer(images).split(6, 2) for rows in half.split(5, 3)]
    expected = torch.stack([quarter.amax((2, 3)) for quarter in quarters], 2).flatten(1)
    torch.testing.assert_close(layer.maxima(images, 2), expected, rtol=1e-12, atol=0)


@pytest.mark.slow
@given(layers(means=MEANS), seeds)
def test_a_batch_is_its_images_one_after_the_other(case, seed):
    layer, _ = case
    images = random_images(seed, 3, 1, 13, 10)
    torch.testing.assert_close(
        layer(images), torch.cat([layer(image[None]) for image in images]), rtol=1e-11, atol=1e-12
    )


@pytest.mark.slow
@given(layers(means=MEANS), seeds)
def test_many_filters_are_those_filters_one_after_the_other(case, seed):
    layer, filters = case
    images = random_images(seed, 2, 1, 13, 10)
    names = ("blur", "tolerance", *layer.options())
    options = {name: getattr(layer, name) for name in names}
    alone = torch.cat([with_parts(layer.bank, parts, **options)(images) for parts in filters], 1)
    torch.testing.assert_close(layer(images), alone, rtol=1e-11, atol=1e-12)


@pytest.mark.slow
@given(layers(means=MEANS, tolerant=False), seeds)
def test_a_tolerant_filter_never_answers_less_than_a_strict_one(case, seed):
    strict, filters = case
    strict.t3 = 0.0
    images = random_images(seed, 1, 1, 13, 10)
    options = {name: getattr(strict, name) for name in ("blur", *strict.options())}
    tolerant = with_parts(strict.bank, *filters, tolerance=Tolerance(3, 360.0, (1.0, 0.8), True), **options)
    assert (tolerant(images) >= strict(images) * (1 - 1e-12)).all()


def test_the_weighted_mean_of_two_parts_by_hand():
    """One part at the centre with weight 1, and one 4 pixels to its right with weight 0.5: R = (s0 s1^0.5)^(1/1.5)."""
    channel = (1.0, 1.0)
    parts = [(channel, 0.0, 0.0), (channel, 4.0, 0.0)]
    layer = with_parts(DoGBank((1.0,)), parts, blur=Blur(0.0, 0.0), least_weight=0.5)
    images = random_images(0, 1, 1, 9, 16)
    map_ = layer.bank.describe(images)[0, 0]
    expected = (map_[:, :-4] * map_[:, 4:] ** 0.5) ** (1 / 1.5)
    torch.testing.assert_close(layer(images)[0, 0, :, :-4], expected)
    assert not layer(images)[0, 0, :, -4:].any()  # beyond the border there is nothing


def test_phi_turns_counter_clockwise_with_y_upwards():
    """A part at 90 degrees lies above the centre: a dot is found below itself."""
    image = torch.zeros(1, 1, 15, 15)
    image[0, 0, 5, 7] = 1
    layer = with_parts(DoGBank((1.0,)), [((1.0, 1.0), 3.0, math.pi / 2)], blur=Blur(0.0, 0.0))
    assert int(layer(image)[0, 0].argmax()) == 8 * 15 + 7


SHAPES = {
    "corner": lambda y, x: (x >= 0) & (y <= 0),
    "crossing": lambda y, x: (abs(x) <= 1) | (abs(y) <= 1),
    "tee": lambda y, x: ((abs(x) <= 1) & (y >= 0)) | (abs(y) <= 1),
    "wye": lambda y, x: ((abs(x) <= 1) & (y >= 0)) | ((abs(abs(x) + y) <= 1.5) & (y <= 0)),
}


def drawn(shape, size=61):
    rows, columns = np.mgrid[:size, :size] - size // 2
    return torch.from_numpy(SHAPES[shape](rows, columns).astype(float))[None, None]


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("tolerance", [Tolerance(), Tolerance(8, 360.0, reflection=True)])
def test_a_filter_answers_most_at_its_own_prototypes_point(shape, tolerance):
    layer = preset("traffic_sign")
    layer.tolerance = tolerance
    image = drawn(shape)
    response = layer.configure(image).forward(image)[0, 0]
    y, x = divmod(int(response.argmax()), image.shape[-1])
    assert max(abs(y - 30), abs(x - 30)) <= 1
    assert response[30, 30] >= 0.95 * response.max()


TURNS = {
    "quarter turn": lambda maps: torch.rot90(maps, 1, (-2, -1)),
    "half turn": lambda maps: torch.rot90(maps, 2, (-2, -1)),
    "mirror": lambda maps: maps.flip(-1),
    "mirror upside down": lambda maps: maps.flip(-2),
    "transposed": lambda maps: maps.transpose(-2, -1),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    "bank", [GaborBank((4.0,), 8), GaborBank((4.0,), 16, phase_deg=90.0), DoGBank((2.0,), (1, -1))]
)
@pytest.mark.parametrize("mean", ["geometric", "arithmetic"])
def test_turned_and_mirrored_images_give_turned_and_mirrored_responses_if_that_is_tolerated(turn, bank, mean):
    moved, image = TURNS[turn], random_images(0, 1, 1, 31, 26)
    example = random_images(1, 1, 25, 25)
    tolerant = Cosfire(bank, tolerance=Tolerance(4, 360.0, reflection=True), mean=mean).configure(example)
    torch.testing.assert_close(tolerant(moved(image)), moved(tolerant(image)), rtol=1e-6, atol=1e-9)
    strict = Cosfire(bank, mean=mean).configure(example)
    difference = (strict(moved(image)) - moved(strict(image))).abs().max()
    assert difference > 0.1 * strict(image).max()


def test_a_larger_copy_is_found_if_that_is_tolerated():
    small, large = (torch.zeros(1, 1, 81, 81, dtype=torch.float64) for _ in range(2))
    for image, width, reach in ((small, 1, 12), (large, 3, 24)):
        image[..., 40 - reach : 41 + reach, 40 - width : 41 + width] = 1
        image[..., 40 - width : 41 + width, 40 - reach : 41 + reach] = 1
    options = {"blur": Blur(0.67, 0.1), "mean": "geometric"}
    strict = Cosfire(GaborBank((6.0,), 8, phase_deg=0.0), **options).configure(small)
    tolerant = Cosfire(
        GaborBank((6.0,), 8, phase_deg=0.0), tolerance=Tolerance(scales=(1.0, 2.0)), **options
    ).configure(small)
    torch.testing.assert_close(tolerant(small)[0, 0, 40, 40], strict(small)[0, 0, 40, 40])
    assert tolerant(large)[0, 0, 40, 40] > 1.5 * strict(large)[0, 0, 40, 40]


@pytest.mark.parametrize("mean", MEANS)
def test_between_pixels_at_whole_offsets_is_the_same_as_whole(mean):
    channel = (1.0, 1.0)
    parts = [(channel, rho, turn * math.pi / 2) for turn, rho in enumerate([0.0, 2.0, 3.0, 5.0])]
    images = random_images(0, 2, 1, 12, 11)
    whole, bilinear = (
        with_parts(DoGBank((1.0,)), parts, mean=mean, shift=shift)(images) for shift in ("whole", "bilinear")
    )
    torch.testing.assert_close(bilinear, whole, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (3, 2), (5, 40)])
@pytest.mark.parametrize("border", ["zeros", "replicate", "reflect", "circular"])
@pytest.mark.parametrize("name", ["digit", "vessel_drive"])
def test_images_smaller_than_the_filter_have_responses_of_their_size(size, border, name):
    layer = preset(name)
    layer.border = layer.bank.border = border
    layer.configure(drawn("tee"))
    response = layer(random_images(0, 2, 1, *size))
    assert response.shape == (2, 1, *size)
    assert response.isfinite().all()


def test_a_floor_keeps_one_missing_part_from_silencing_the_filter():
    channel = (1.0, 1.0)
    parts = [(channel, 0.0, 0.0), (channel, 3.0, 0.0)]
    image = torch.zeros(1, 1, 15, 15)
    image[..., 7, 7] = 1
    options = {"blur": Blur(0.0, 0.0), "least_weight": 1.0}
    silent, heard = (with_parts(DoGBank((1.0,)), parts, floor=floor, **options)(image) for floor in (0.0, 0.01))
    assert silent[0, 0, 7, 7] == 0
    torch.testing.assert_close(heard[0, 0, 7, 7], (DoGBank((1.0,)).describe(image).max() * 0.01).sqrt())
    assert heard.min() == pytest.approx(0.01)  # nothing anywhere


def test_a_tile_with_less_than_the_share_of_the_strongest_has_nothing():
    layer = with_parts(DoGBank((1.0,)), [((1.0, 1.0), 0.0, 0.0)], t3=0.9)
    images = random_images(0, 2, 1, 12, 10)
    expected = torch.nn.functional.adaptive_max_pool2d(layer(images), 2).flatten(1)
    assert (expected == 0).any()
    torch.testing.assert_close(layer.maxima(images, 2), expected)


def test_no_tiles_are_refused():
    with pytest.raises(ValueError, match="at least one tile per side, got 0"):
        preset("traffic_sign").configure(drawn("tee")).maxima(drawn("tee"), 0)


def test_what_is_no_number_stays_so_and_is_never_taken_for_nothing():
    layer = preset("traffic_sign").configure(drawn("tee"))
    image = drawn("tee")
    image[..., 20, 20] = float("nan")
    assert layer(image)[0, 0, 21, 21].isnan()
    assert layer.maxima(image).isnan().all()
    assert layer.maxima(image, 2).isnan().all()


@pytest.mark.parametrize(
    "options",
    [
        {"least_weight": 0.0},
        {"least_weight": 1.5},
        {"t1": -0.1},
        {"t3": 1.1},
        {"floor": -1.0},
        {"floor": float("nan")},
        {"floor": float("inf")},
        {"mean": "mode"},
        {"shift": "nearest"},
        {"border": "wrap"},
    ],
)
def test_options_that_cannot_be_are_refused(options):
    with pytest.raises(ValueError, match="must be"):
        Cosfire(GaborBank(), **options)


def test_a_layer_without_filters_says_so():
    layer = Cosfire(GaborBank())
    assert len(layer) == 0
    for ask in (layer, layer.maxima):
        with pytest.raises(UserError, match="no COSFIRE filter is configured"):
            ask(torch.zeros(1, 1, 9, 9))


def test_images_of_bytes_are_refused_in_one_message():
    layer = preset("digit").configure(drawn("tee"))
    for ask in (layer, layer.maxima, layer.configure):
        with pytest.raises(UserError, match=r"floating-point images, got torch\.uint8"):
            ask(torch.zeros(1, 1, 28, 28, dtype=torch.uint8))


@pytest.mark.slow
@given(layers(means=MEANS), seeds)
def test_a_state_dict_makes_a_fresh_layer_the_same_whatever_it_held(case, seed):
    layer, filters = case
    options = {name: getattr(layer, name) for name in ("blur", "tolerance", *layer.options())}
    images = random_images(seed, 1, 1, 9, 9)
    for held in ([], filters[:1] * 3):
        fresh = with_parts(layer.bank, *held, **options)
        fresh.load_state_dict(layer.state_dict())
        assert len(fresh) == len(layer)
        assert torch.equal(fresh(images), layer(images))


def test_a_state_dict_of_another_bank_is_refused():
    layer = preset("digit").configure(drawn("tee"))
    state = {**layer.state_dict(), "channels": torch.zeros(len(layer.rho), 3)}
    with pytest.raises(RuntimeError, match="size mismatch for channels"):
        preset("digit").load_state_dict(state)


def test_a_copy_is_the_same_and_stands_alone():
    layer, image = preset("digit").configure(drawn("tee")), drawn("corner")
    layer(image)
    twin = copy.deepcopy(layer)
    assert torch.equal(twin(image), layer(image))
    twin.configure(drawn("corner"))
    assert (len(layer), len(twin)) == (1, 2)
    assert torch.equal(twin(image)[:, :1], layer(image))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16, torch.bfloat16])
def test_parts_are_as_exact_as_before_when_the_layer_is_moved_to_another_dtype(dtype):
    layer, image = preset("digit").configure(drawn("tee")), drawn("corner")
    before = layer(image)
    layer.to(dtype).double()
    assert torch.equal(layer(image), before)
    assert layer.form.dtype == layer.filter_of_form.dtype == torch.int64


def test_a_blur_that_is_set_later_counts():
    layer, image = preset("digit").configure(drawn("tee")), drawn("corner")
    before = layer(image)
    layer.blur = Blur(2.0, 0.2)
    after = layer(image)
    layer.blur = Blur(0.83, 0.1)
    assert not torch.equal(after, before)
    assert torch.equal(layer(image), before)


def test_parts_can_be_taken_away_in_all_forms():
    layer = preset("vessel_drive").configure(drawn("crossing"))
    before, moves = len(layer.tuples(0)), 12
    layer.keep(lambda parts: parts.rho <= 4)
    after = layer.tuples(0)
    assert 0 < len(after) < before
    assert after.rho.max() == 4
    assert len(layer.rho) == moves * len(after)
    torch.testing.assert_close(layer.weights, torch.full_like(layer.weights, 1 / len(after)))
    assert layer(drawn("crossing")).max() > 0


def test_the_last_part_cannot_be_taken_away():
    layer = preset("digit").configure(drawn("tee"))
    with pytest.raises(UserError, match="no part of the filter is left"):
        layer.keep(lambda parts: parts.rho < 0)


def test_the_last_filter_and_all_filters_can_be_taken_away():
    layer, image = preset("digit").configure(drawn("tee")), drawn("tee")
    first = layer(image)
    layer.configure(drawn("corner")).drop_last()
    assert torch.equal(layer(image), first)
    assert len(layer.clear()) == 0
    assert torch.equal(layer.configure(drawn("tee"))(image), first)


def test_the_parts_told_are_those_of_the_prototype_wherever_scale_1_stands():
    layer = Cosfire(GaborBank(), tolerance=Tolerance(2, 360.0, (0.75, 1.0, 2.0))).configure(drawn("tee"))
    alone = Cosfire(GaborBank()).configure(drawn("tee"))
    assert torch.equal(layer.tuples(0).rho, alone.tuples(0).rho)
    with pytest.raises(IndexError):
        layer.tuples(1)
