"""What figures of calibration show of a camera, and how they call it."""

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
    """Tilt, roll and nominal vertical field of view in degrees, and apparent distortion."""
    values = {
        "tilt": rad2deg(camera.tilt),
        "roll": rad2deg(camera.roll),
        "vfov": rad2deg(vfov_from_focal(camera.focal)),
        "k1_hat": camera.k1 / camera.focal.square(),
    }
    return {name: tensor.detach().cpu().double().numpy() for name, tensor in values.items()}
