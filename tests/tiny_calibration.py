"""A checkpoint of calibration as a run leaves it, of a network that was never trained."""

import torch
from cli.photo_calibration.fakes import SPREAD

from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.geometry import CameraParameters, Parameterization, ParameterSpace
from sextant.registry import chapter_of
from sextant.runs.checkpoint import KEY, SCHEMA_VERSION
from sextant.torch_file import save_sealed

CAMERAS = CameraParameters(*(torch.linspace(a, b, 9) for a, b in ((-0.3, 0.3), (-0.2, 0.2), (0.5, 1.4), (-0.4, 0.0))))


def tiny_spec():
    space = ParameterSpace.covering(Parameterization(), CAMERAS)
    return {
        "height": 18, "width": 24, "aspects": [1.0, 4 / 3], "low": space.low.tolist(), "high": space.high.tolist(),
        "validation_crops": 100, "per_panorama": 1, "median": [0.0, 0.0, 0.8, -0.2], "spread": list(SPREAD),
    }  # fmt: skip


def tiny_module():
    """The module that a run trains, as its chapter makes it, and its config."""
    sizes = ["task.width=24", "task.height=18", "backbone=strided_cnn", "backbone.widths=[8,8]"]
    raw = to_plain(compose(["task=calibration", *sizes]))
    torch.manual_seed(0)
    module = chapter_of("calibration").module(validate(raw), tiny_spec(), training=False).eval()
    looks = torch.randn(100, 16, generator=torch.Generator().manual_seed(0))
    module.keep_validation(torch.linspace(0.02, 2, 100)[:, None].expand(-1, 4), looks, torch.arange(100) // 4)
    return module, raw


def tiny_checkpoint(path):
    """Write one to ``path``."""
    module, raw = tiny_module()
    trained = {"schema_version": SCHEMA_VERSION, "config": raw, "spec": tiny_spec(), "task": "calibration"}
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        save_sealed({KEY: trained, "state_dict": module.state_dict()}, file)
    return path
