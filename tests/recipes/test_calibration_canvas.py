"""A network for pictures of every shape, from its config to its answer."""

import copy
from functools import partial

import numpy as np
import pytest
import torch
from calibration_toy import ToyPanoramas

from sextant.chapters.calibration.network import network_parts
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.config.building import build
from sextant.config.digest import digest
from sextant.data.photos import network_view, photo_of_array
from sextant.errors import UserError
from sextant.geometry.canvas import on_canvas
from sextant.geometry.perspective_field import perspective_field
from sextant.losses.camera_losses import field_loss
from sextant.registry import chapter_of

SMALL = [
    "experiment=calibration_held", "dataset.sources.real.folder=/nowhere", "backbone.weights=null", "backbone.stages=2",
    "backbone.frozen_stages=0", "backbone.grid=[2,2]", "task.width=32", "task.height=32", "task.canvas.lines=28",
    "task.crops_per_panorama={train: 4, val: 4, test: 2}",
]  # fmt: skip
FIELD = [*SMALL, "task.perspective_field={weight: 0.1}"]


@pytest.fixture(scope="module", params=[SMALL, FIELD], ids=["heads", "field"])
def parts(request):
    chapter, config = chapter_of("calibration"), validate(to_plain(compose(request.param)))
    data = chapter.data(config, ToyPanoramas())
    spec = chapter.spec(config, ToyPanoramas(), data)
    torch.manual_seed(0)
    return chapter.module(config, spec, training=False).eval(), spec, data


def test_ranges_are_those_of_the_longer_side(parts):
    _, spec, _ = parts
    assert spec["canvas"]
    fields = 2 * np.degrees(np.arctan(0.5 / np.array([120 / 36, 12 / 36])))
    np.testing.assert_allclose(np.degrees([spec["low"][2], spec["high"][2]]), fields, atol=3)
    assert min(spec["aspects"]) == pytest.approx(9 / 16)
    assert max(spec["aspects"]) == pytest.approx(16 / 9)


def test_a_training_step_is_finite_and_knows_the_pictures_shapes(parts):
    module, _, data = parts
    data.setup("fit")
    batch = data.split("train")[list(range(16))]
    assert batch.images.shape == (16, 3, 32, 32)
    assert len(batch.aspect.unique()) > 2
    step = module.train().training_step(batch, 0)
    step.backward()
    module.eval()
    assert step.isfinite()
    assert torch.allclose(
        module.decoded(module.encoded(batch.cameras, batch.aspect), batch.aspect).focal, batch.cameras.focal
    )


def test_the_mirror_image_has_the_opposite_roll_and_nothing_else(parts):
    module, _, data = parts
    batch = data.split("val")[list(range(8))]
    images = batch.images_in_unit_range()
    here, there = module(images, batch.aspect)[0], module(images.flip(-1), batch.aspect)[0]
    torch.testing.assert_close(there.roll, -here.roll)
    for name in ("tilt", "focal", "k1"):
        torch.testing.assert_close(getattr(there, name), getattr(here, name))


def test_upright_photos_are_seen_whole_and_their_field_of_view_is_theirs(parts):
    """Turned to their side, photos have another vertical field of view and the same focal length in pixels."""
    module, spec, _ = parts
    module.keep_validation(*(torch.rand(module.spec.validation_crops, n) for n in (4, 16)), torch.arange(24) // 4)
    image = np.random.default_rng(0).integers(0, 256, (160, 90, 3), np.uint8)
    view = network_view(photo_of_array(image, "a"), spec["aspects"], 32, 32, canvas=True)
    assert (view.width, view.height, view.share) == (90, 160, 1)
    said = module.predict(torch.from_numpy(view.image.transpose(2, 0, 1).copy())[None], torch.tensor([view.aspect]))
    longer_side = module.encoded(said.parameters, torch.tensor([view.aspect]))[0, 2]
    assert float(2 * torch.atan(0.5 / said.parameters.focal)) == pytest.approx(float(longer_side))


@pytest.fixture
def with_field():
    config = validate(to_plain(compose(FIELD)))
    chapter = chapter_of("calibration")
    data = chapter.data(config, ToyPanoramas())
    torch.manual_seed(0)
    module = chapter.module(config, chapter.spec(config, ToyPanoramas(), data), training=True).train()
    return module, data.split("val")[list(range(24))]


def test_a_field_is_learnt_from_the_camera_that_is_fitted_to_it(with_field):
    module, batch = with_field
    module.field_weight = 0.0
    module.training_step(batch, 0).backward()
    assert all(parameter.grad.abs().sum() > 0 for parameter in module.network.field.parameters())
    with torch.no_grad():
        output = module.network(batch.images_in_unit_range(), batch.aspect)
        said, fitted = module.camera(output, None, batch.aspect), module.fitted(output, batch.aspect)
    assert not torch.allclose(module.camera(output, fitted, batch.aspect).tilt, said.tilt)


def test_a_field_is_learnt_from_what_each_cell_shows(with_field):
    module, batch = with_field
    optimizer = torch.optim.Adam(module.parameters(), 3e-3)
    points, seen = module.cell_centres(batch.aspect)
    true = perspective_field(on_canvas(batch.cameras, batch.aspect), points)
    losses = []
    for _ in range(30):
        loss = field_loss(module.network(batch.images_in_unit_range(), batch.aspect).believed, true, seen).mean()
        losses.append(loss.item())
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert losses[-1] < losses[0] - 1


def test_a_run_goes_on_from_one_without_a_field_and_learns_it_anew(with_field):
    module, _ = with_field
    before = {name: value for name, value in module.state_dict().items() if ".field." not in name}
    other = copy.deepcopy(module)
    for parameter in other.parameters():
        torch.nn.init.normal_(parameter)
    other.load_state_dict(before)
    assert torch.equal(other.network.values[0][0].weight, module.network.values[0][0].weight)
    assert not torch.equal(other.network.field.out.weight, module.network.field.out.weight)
    del before["network.values.0.0.weight"]
    with pytest.raises(RuntimeError, match=r"network\.values"):
        other.load_state_dict(before)


def test_runs_from_before_fields_are_the_same_experiment_as_those_without_one():
    before = to_plain(compose(SMALL))
    without = {**before, "task": {key: value for key, value in before["task"].items() if key != "perspective_field"}}
    assert digest(before) == digest(without) != digest(to_plain(compose(FIELD)))


def test_a_field_needs_numbers_that_tell_any_camera():
    plain = validate(to_plain(compose([*FIELD, "parameterization=horizon"]))).plain
    chapter, config = chapter_of("calibration"), validate(to_plain(compose(FIELD)))
    spec = chapter.spec(config, ToyPanoramas(), chapter.data(config, ToyPanoramas()))
    with pytest.raises(UserError, match=r"task.perspective_field: parameterization=horizon") as told:
        network_parts(plain, spec, partial(build, plain))
    assert "parameterization=angles or direct" in str(told.value)


def test_a_field_needs_a_backbone_that_shows_its_map():
    config = validate(to_plain(compose(FIELD)))
    plain = config.plain | {
        "backbone": to_plain(compose(["task=calibration", "backbone=mobilenet_v3_small"]))["backbone"]
    }
    chapter = chapter_of("calibration")
    spec = chapter.spec(config, ToyPanoramas(), chapter.data(config, ToyPanoramas()))
    with pytest.raises(UserError, match=r"task.perspective_field: MobileNetV3") as told:
        network_parts(plain, spec, partial(build, plain))
    assert "backbone=efficientnet_lite0" in str(told.value)


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("task.perspective_field.weight=0", "task.perspective_field.weight"),
        ("task.canvas=null", "task.perspective_field needs pictures on a canvas"),
        ("task.width=33", "squares of an even number of pixels"),
        ("task.height=48", "squares of an even number of pixels"),
        ("task.geometric_baselines=true", "the geometric baselines do not support"),
    ],
)
def test_a_canvas_is_an_even_square_without_geometric_methods(override, says):
    with pytest.raises(UserError, match=says):
        validate(to_plain(compose([*FIELD, override])))
