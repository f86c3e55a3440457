"""Networks of others in the calibrator: what they say counts as much as their spreads allow.

Files hold random weights in the layouts of the authors: no real weights were run.
"""

import math

import numpy as np
import pytest
import torch
from baselines.calibration.drawings import cameras, picture
from models.published_cameras import FILES
from torch import nn

from sextant.applications import FailedPhoto, PhotoCalibrator
from sextant.baselines.calibration import CameraBelief, ObservedField, map_points
from sextant.chapters.calibration.finding import STUDENT
from sextant.chapters.calibration.metrics.photo_benchmark import Answers, Truth
from sextant.chapters.calibration.network_scale import fit_scale, read_scale, write_scale
from sextant.chapters.calibration.other_networks import FieldSource, RaySource, card_text, open_network
from sextant.errors import UserError
from sextant.geometry import CameraParameters
from sextant.geometry.perspective import perspective_bearings
from sextant.geometry.perspective_field import perspective_field
from sextant.models.field_net import PredictedField

SAYS = (0.2, -0.1, 0.9, -0.05)
WIDE, TALL = (400, 300), (330, 500)


def truth():
    return CameraParameters(*torch.tensor(SAYS, dtype=torch.float64))


class Belief:
    """A network that says one camera of every photo."""

    def __init__(self, sigma):
        self.sigma = sigma

    def predict(self, image):
        tilt, roll, focal, k1 = SAYS
        return CameraBelief(tilt, roll, focal, k1 / focal**2, self.sigma)


class Field:
    """A network that says the exact field of a camera, with one spread."""

    def __init__(self, spread):
        self.spread = spread

    def predict(self, image):
        points = map_points(12, 16, image.shape[1] / image.shape[0])
        field, spread = perspective_field(truth(), torch.from_numpy(points)), np.full(len(points), self.spread)
        return ObservedField(points, field.latitude.numpy(), field.up.numpy(), spread, spread)


def dots(size=WIDE):
    return np.random.default_rng(0).integers(60, 80, (size[1], size[0], 3)).astype(np.uint8)


def numbers(camera):
    return math.radians(camera.tilt_deg), math.radians(camera.roll_deg), camera.focal_px / camera.height, camera.k1


def test_a_camera_and_a_field_are_taken_as_they_are():
    for network in (Belief((0.01, 0.01, 0.02, 0.02)), Field(0.01)):
        camera = PhotoCalibrator(network, "network").calibrate(dots())
        assert numbers(camera) == pytest.approx(SAYS, abs=1e-6)
        assert camera.intervals_by == "the network's spreads, Student's t"
        assert camera.width_over_training_spread == {}
        assert camera.verdict == "good"  # by the absolute limits, since its training is not known
    low, high = PhotoCalibrator(Belief((0.01, 0.01, 0.02, 0.02)), "network").calibrate(dots()).interval_95.tilt_deg
    assert math.radians(high - low) / 2 == pytest.approx(0.03182, rel=1e-3)


@pytest.mark.slow
def test_the_joint_camera_leans_on_a_sure_network_and_on_lines_beside_a_vague_one():
    tilt, roll, heading, focal, _ = list(cameras(8, k1=(-0.01, 0.0)))[1]
    image = picture(tilt, roll, heading, focal, 0.0, width=400, height=300, noise=6)
    off = []
    for spread in (0.003, 0.3, 30.0):
        found = numbers(PhotoCalibrator(Field(spread)).calibrate(image))
        off.append(abs(found[0] - tilt))
    lines = numbers(PhotoCalibrator(Field(0.01), "lines").calibrate(image))
    assert abs(lines[0] - tilt) < math.radians(1)
    assert off[2] < math.radians(1.5)
    assert off[0] > off[1] >= off[2] - 1e-3
    alone = numbers(PhotoCalibrator(Field(0.003)).calibrate(dots()))
    assert alone[:3] == pytest.approx(SAYS[:3], abs=0.02)  # no lines: the network leads


@pytest.mark.parametrize("scale", [(3.0, 1.0, 1.0, 1.0), np.array([3.0, 1, 1, 1])])
def test_the_scale_multiplies_the_spreads(scale):
    once, scaled = (
        PhotoCalibrator(Belief((0.01, 0.01, 0.02, 0.02)), "network", scale=scale).calibrate(dots())
        for scale in (None, scale)
    )
    widths = [each.interval_68.tilt_deg[1] - each.interval_68.tilt_deg[0] for each in (once, scaled)]
    assert widths[1] == pytest.approx(3 * widths[0])
    assert once.interval_68.roll_deg == scaled.interval_68.roll_deg


class Positions(nn.Module):
    """A stub of a network, which reads positions in the photo from its colours and says a camera's field or rays."""

    def __init__(self, aspect):
        super().__init__()
        self.aspect, self.patch = aspect, 14

    def points(self, images):
        x, y = (images[0, k].double() * 255 / 200 - 0.5 for k in (0, 1))
        return torch.stack([x * self.aspect, y], -1)


class FieldStub(Positions):
    def forward(self, images):
        assert images.shape[-1] % 32 == images.shape[-2] % 32 == 0
        points = self.points(images)
        field = perspective_field(truth(), points.flatten(0, 1))
        sure = torch.full(points.shape[:2], 0.25)[None]
        latitude, up = field.latitude.reshape(sure.shape), field.up.T.reshape(1, 2, *points.shape[:2])
        return PredictedField(latitude, up, sure, sure)


class RayStub(Positions):
    def forward(self, images):
        assert abs(images.shape[-1] * images.shape[-2] - 102_400) < 6_000
        camera = truth()
        k1 = camera.k1[None, None]
        points = self.points(images)
        return perspective_bearings(points, camera.focal[None, None], k1, 0.019 * k1 + 0.805 * k1 * k1).movedim(-1, 0)[
            None
        ]


@pytest.mark.parametrize("size", [WIDE, TALL, (900, 300)])
@pytest.mark.parametrize(("stub", "source"), [(FieldStub, FieldSource), (RayStub, RaySource)])
def test_what_a_network_sees_is_placed_where_it_is_in_the_photo(size, stub, source):
    """Through resizing and cropping, points are right to less than the rounding of colours."""
    width, height = (2 * side for side in size)
    x, y = (np.arange(width) + 0.5) / width, (np.arange(height) + 0.5) / height
    image = np.zeros((height, width, 3), np.uint8)
    image[..., 0], image[..., 1] = np.round(200 * x), np.round(200 * y)[:, None]
    said = source(stub(width / height)).predict(image)
    belief = said.belief()
    assert belief.focal == pytest.approx(0.9, rel=0.01)
    if source is FieldSource:
        assert (belief.tilt, belief.roll) == pytest.approx(SAYS[:2], abs=0.003)
        assert said.up_sigma == pytest.approx(0.02)  # of confidence 0.25


def test_the_name_tells_weights_of_pictures_without_distortion(tmp_path):
    torch.save(FILES["geocalib"](), tmp_path / "geocalib-pinhole.tar")
    network = open_network(f"geocalib:{tmp_path / 'geocalib-pinhole.tar'}")
    assert "trained without distortion by its name (pinhole)" in card_text(network.card)
    assert network.predict(dots((96, 64))).belief().sigma[3] == math.inf


def test_points_of_no_confidence_have_no_say():
    class Unsure(FieldStub):
        def forward(self, images):
            field = super().forward(images)
            sure = field.latitude_confidence.clone()
            sure[:, :160] = 0
            field.latitude[:, :160] = 1.0
            return field._replace(latitude_confidence=sure)

    x, y = (np.arange(400) + 0.5) / 400, (np.arange(400) + 0.5) / 400
    image = np.zeros((400, 400, 3), np.uint8)
    image[..., 0], image[..., 1] = np.round(200 * x), np.round(200 * y)[:, None]
    belief = FieldSource(Unsure(1.0)).predict(image).belief()
    assert (belief.tilt, belief.roll) == pytest.approx(SAYS[:2], abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_a_file_of_either_kind_calibrates_a_photo(kind, tmp_path):
    torch.save(FILES[kind](), tmp_path / "theirs.pt")
    network = open_network(f"{kind}:{tmp_path / 'theirs.pt'}")
    told = card_text(network.card)
    assert "not supplied by Sextant" in told
    assert network.card["sha256"] in told
    camera = PhotoCalibrator(network).calibrate(dots())
    assert not isinstance(camera, FailedPhoto)
    assert camera.verdict == "not trustworthy"


def test_photos_of_one_camera_are_fused():
    images = [dots(), np.ascontiguousarray(dots()[:, ::-1])]
    for method in ("network", "joint"):
        one = PhotoCalibrator(Field(0.01), method).one_camera(images)
        assert one.focal_of_longer_side == pytest.approx(0.9 * 3 / 4, rel=0.02)
        assert one.fusion.consistent


def test_mistakes_are_told(tmp_path):
    with pytest.raises(UserError, match="has no method predict"):
        PhotoCalibrator(object())
    with pytest.raises(UserError, match="has no method predict"):
        PhotoCalibrator(Field)  # the class, not an object of it
    for scale in ((1.0, 0.0, 1.0, 1.0), (1, 2, 3), (), ("a", 1, 1, 1), [[1], [2, 3]], 1.0):
        with pytest.raises(UserError, match=r"scale=.* must be 4 values, each a number above 0"):
            PhotoCalibrator(Field(0.1), scale=scale)
    with pytest.raises(UserError, match="four sigma > 0"):
        CameraBelief(0.0, 0.0, 1.0, 0.0, sigma=(0.1, 0.1, 0.1))
    with pytest.raises(UserError, match="must be geocalib:<file> or anycalib:<file>"):
        open_network("deepcalib:weights.h5")

    class Numbers:
        def predict(self, image):
            return (0.0, 0.0, 1.0, 0.0)

    with pytest.raises(UserError, match=r"network.predict returned tuple, not a CameraBelief"):
        PhotoCalibrator(Numbers()).calibrate(dots())


def known(errors, sources):
    count = len(errors)
    truth = Truth(np.array([[0.0, 0.0, 1.0, np.nan]] * count), np.ones(count), sources)
    said = np.column_stack([errors, np.zeros(count), np.ones(count), np.zeros(count)])
    return truth, Answers(said, {"68": np.full((count, 4), 0.01 * STUDENT["68"])}, ["good"] * count)


def test_a_scale_is_fitted_kept_and_refused_for_another_network(tmp_path):
    errors = 0.03 * np.random.default_rng(0).standard_t(3, 300)
    found = fit_scale(*known(errors, [str(k % 10) for k in range(300)]))
    assert found.values[0] == pytest.approx(3, rel=0.15)
    assert found.values[3] == 1.0  # k1 is not known
    before, after = found.coverage["68"][0]
    assert before < 0.4
    assert after == pytest.approx(0.68, abs=0.06)
    write_scale(tmp_path / "s.json", found, {"kind": "GeoCalib", "file": "a.tar", "sha256": "1"}, tmp_path)
    assert read_scale(tmp_path / "s.json", {"sha256": "1"}) == pytest.approx(found.values)
    with pytest.raises(UserError, match=r"was fitted for a\.tar, not for b\.tar"):
        read_scale(tmp_path / "s.json", {"file": "b.tar", "sha256": "2"})
    (tmp_path / "other.json").write_text('{"scale": 3}')
    for name in ("other.json", "gone.json"):
        with pytest.raises(UserError, match="is not a file of the scales of a network"):
            read_scale(tmp_path / name, {})


def test_few_photos_give_no_scale():
    assert fit_scale(*known(np.full(5, 0.3), list("abcde"))).values == (1.0, 1.0, 1.0, 1.0)
