"""The quantities of a camera shown in calibration figures, and their labels."""

from jaxtyping import Float
from numpy import ndarray
from torch import rad2deg

from sextant.geometry import CameraParameters, vfov_from_focal

#: quantities of a camera with their axis labels
QUANTITIES = {"tilt": "tilt (°)", "roll": "roll (°)", "vfov": "vertical field of view (°)", "k1_hat": "k1 / f²"}
#: errors with their axis labels
ERROR_LABELS = {
    "tilt_deg": "tilt error (°)",
    "roll_deg": "roll error (°)",
    "vfov_deg": "vfov error (°)",
    "true_vfov_deg": "true vfov error (°)",
    "focal_percent": "focal error (%)",
    "k1": "k1 error",
    "k1_hat": "k1 / f² error",
    "bearing_deg": "bearing error (°)",
    "undistortion_px": "undistortion error\n(px of 480)",
}


def camera_quantities(camera: CameraParameters) -> dict[str, Float[ndarray, "n"]]:
    """Tilt, roll and nominal vertical field of view in degrees, and apparent distortion.

    >>> import torch
    >>> tilt, roll, focal, k1 = torch.tensor([[0.1], [0.0], [0.5], [-0.05]])
    >>> found = camera_quantities(CameraParameters(tilt, roll, focal, k1))
    >>> {name: float(values[0].round(2)) for name, values in found.items()}
    {'tilt': 5.73, 'roll': 0.0, 'vfov': 90.0, 'k1_hat': -0.2}
    """
    values = {
        "tilt": rad2deg(camera.tilt),
        "roll": rad2deg(camera.roll),
        "vfov": rad2deg(vfov_from_focal(camera.focal)),
        "k1_hat": camera.k1 / camera.focal.square(),
    }
    return {name: tensor.detach().cpu().double().numpy() for name, tensor in values.items()}
