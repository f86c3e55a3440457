"""A network that says what is written into the photos, and photos for it."""

import torch
from PIL import Image

from sextant.applications import PhotoCalibrator
from sextant.chapters.calibration.network import CalibrationPrediction, CalibrationSpec, CameraNetwork
from sextant.chapters.calibration.options import CalibrationOptions
from sextant.chapters.calibration.predict import predict_calibrations
from sextant.geometry import CameraParameters, Parameterization, PerspectiveCamera

SCALE = (0.02, 0.01, 0.03, 0.05)
SPREAD = (0.2, 0.1, 0.3, 0.4)


class Fake(CameraNetwork):
    """A network that says what is written into the photo: grey value g is focal length g / 100 of the part it sees."""

    strangeness = None

    def __init__(self, tilt=0.1, roll=-0.05, k1_hat=-0.3, scale=SCALE, scores=100, place=0.5):
        torch.nn.Module.__init__(self)
        nothing = (0.0, 0.0, 0.0, 0.0)
        self.spec = CalibrationSpec(18, 24, (1.0, 4 / 3), nothing, nothing, scores, 1, nothing, SPREAD)
        self.parameterization = Parameterization()
        self.tilt, self.roll, self.k1_hat, self.scale, self.place = tilt, roll, k1_hat, scale, place
        self.scores = torch.linspace(0.02, 2, scores)[:, None].expand(-1, 4)
        self.seen = []

    def predict(self, images, aspect):
        assert images.dtype == torch.uint8
        assert images.shape[1:] == (3, 18, 24)
        self.seen += aspect.tolist()
        focal = images.float().mean((1, 2, 3)) / 100
        camera = CameraParameters(
            torch.full_like(focal, self.tilt), torch.full_like(focal, self.roll), focal, self.k1_hat * focal**2
        )
        strange = None if self.strangeness is None else torch.full_like(focal, self.strangeness)
        scale = torch.tensor(self.scale).expand(len(focal), 4)
        return CalibrationPrediction(camera, scale, self.scores, strangeness=strange)

    def position(self, camera, aspect):
        return torch.full((len(camera.focal), 4), self.place)


def photo(path, size=(80, 60), grey=70, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, (grey,) * 3).save(path, **options)
    return path


def exif(focal_35mm):
    block = Image.Exif()
    block.get_ifd(0x8769)[0xA405] = focal_35mm
    return block


def calibrate(paths, output, model=None, **options):
    return predict_calibrations(
        PhotoCalibrator(model or Fake(), "network"), paths, output, CalibrationOptions(**options)
    )


def camera_of(row):
    return PerspectiveCamera(
        torch.tensor(row["focal_px"] / row["height"], dtype=torch.float64),
        torch.tensor(row["k1"], dtype=torch.float64),
        torch.tensor(row["k2"], dtype=torch.float64),
        row["width"],
        row["height"],
    )
