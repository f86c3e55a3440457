"""OpenSfM's ``reconstruction.json``: a list of reconstructions, each in its own frame of reference.

``shots`` has for each image an angle-axis ``rotation`` and a ``translation`` that are ``camera_from_world``, with x
right, y down and z forward; ``cameras`` has focal lengths in units of the longer side. The world's z points up, and
lengths are metres if images had GPS. Source: OpenSfM's documentation, "Dataset Structure".
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sextant.data.reconstructions.json_file import read_foreign_json
from sextant.data.reconstructions.reconstruction import (
    Lens,
    PosedImage,
    Reconstruction,
    finite,
    inverted,
    reconstruction_of,
)
from sextant.errors import UserError
from sextant.tables import counted

FIX = "It is the reconstruction.json that opensfm reconstruct or align_submodels wrote."


def read_opensfm(path: Path) -> Reconstruction:
    """Read the images of the largest reconstruction in the file.

    Raises:
        UserError: the file cannot be read, has a different layout, or has an invalid pose; the message names it.
    """
    content = read_foreign_json(path, FIX)
    whole = [each for each in content if isinstance(each, dict)] if isinstance(content, list) else []
    shots = [each["shots"] for each in whole if isinstance(each.get("shots"), dict)]
    if not shots:
        raise UserError(f'{path}: a list of reconstructions with "shots" is expected', FIX)
    largest = max(range(len(shots)), key=lambda i: len(shots[i]))
    lenses = whole[largest].get("cameras")
    remarks = []
    if len(shots) > 1:
        others = sum(map(len, shots)) - len(shots[largest])
        remarks.append(
            f"the largest of {len(shots)} reconstructions; "
            f"{counted(others, 'image of the others is', 'images of the others are')} in other frames"
        )
    known = lenses if isinstance(lenses, dict) else {}
    found = [_image(name, shot if isinstance(shot, dict) else {}, known) for name, shot in shots[largest].items()]
    return reconstruction_of(path, found, remarks, FIX)


def _image(name: str, shot: Mapping[str, Any], lenses: Mapping[str, Any]) -> PosedImage | str:
    turn, translation = finite(shot.get("rotation"), 3), finite(shot.get("translation"), 3)
    if turn is None or translation is None:
        return f"{name}: its rotation and translation are not three finite numbers each"
    rotation = np.asarray(Rotation.from_rotvec(turn).as_matrix())
    return PosedImage(name, inverted(rotation, translation), _lens(lenses.get(str(shot.get("camera")))))


def _lens(camera: Any) -> Lens | None:
    if not isinstance(camera, dict):
        return None
    size = finite([camera.get("width"), camera.get("height")], 2)
    focal = finite(camera.get("focal", camera.get("focal_x")))
    model = str(camera.get("projection_type", "perspective"))
    if size is None:
        return Lens(model, 0, 0, None)
    if focal is None:
        return Lens(model, int(size[0]), int(size[1]), None)
    focal_px, (width, height) = float(focal * size.max()), size.tolist()
    bent, opencv = finite([camera.get("k1", 0.0), camera.get("k2", 0.0)], 2), None
    if model == "perspective" and bent is not None:
        opencv = (focal_px, focal_px, (width - 1) / 2, (height - 1) / 2, *bent.tolist(), 0.0, 0.0)
    return Lens(model, int(width), int(height), focal_px, opencv)
