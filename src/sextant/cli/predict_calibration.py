"""``predict.py`` with a calibration model: from photos of any kind to their cameras, with all that can be said of them.

The network sees the largest centred part of a photo that has an aspect it was trained on; what it finds is told in
pixels of the whole upright original. Where a focal length is known beforehand, or photos are of one camera, the
estimates are fused at fixed appearance: the apparent distortion ``k1 / f²`` and the seen offset of the horizon stay, so
that k1 and tilt follow the new focal length.
"""

import csv
import glob
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
import torch
from rich.markup import escape
from torch import Tensor

from sextant.cli.console import console, rows_table
from sextant.data.image_folder import SUFFIXES
from sextant.data.photos import NetworkView, Photo, network_view, read_photo, undistort_photo
from sextant.errors import UserError
from sextant.evaluation.fusion import Fusion, Prior, fuse, with_prior
from sextant.geometry import (
    CameraParameters,
    K2Family,
    focal_from_vfov,
    k2_of_k1,
    rho_from_tilt,
    tilt_from_rho,
    undistort_radius,
    vfov_from_focal,
)
from sextant.runs.atomic import write_atomically, write_json

if TYPE_CHECKING:
    from sextant.figures.calibration_overlay import CalibratedPhoto
    from sextant.tasks.calibration import Calibration, CalibrationPrediction

KEYS = {
    "undistort": "crop (default: no borders), all (every pixel is kept, with borders) or none (no straightened photos)",
    "camera": "each (default), or one: all photos are of one camera and lens setting, and are fused",
    "focal_prior": "none (default), exif, or a focal length in pixels of the photo",
}
LEVELS = {"68": (0.68, 1.0), "95": (0.95, 1.96)}  # name: share of photos, and multiple of a normal standard error
BATCH = 64
SHEET = 40
FOUND_IN_FOLDERS = (*SUFFIXES, ".gif", ".jp2", ".avif", ".heic", ".heif")  # the last two so that they are named
WRITTEN = ("_overlay.png", "_undistorted.png", "_undistorted.jpg", "calibrations.png")
#: standard deviation of the log of a focal length. EXIF: whole millimetres (2 % at 26 mm), makers that compare widths
#: and not diagonals (4 %), lens corrections that crop. Given by hand: as a person knows it.
PRIOR_SIGMA = {"exif": 0.05, "given": 0.02}
PRIOR_DISAGREES = 3.0  # standard errors
SAME_SHAPE = 0.02  # largest relative difference of aspect among photos of one camera
GOOD, TRUSTWORTHY = 0.5, 1.0  # half-width of a 68 % interval, in half-widths of the central 68 % trained on
LITTLE_SEEN = 0.6  # of the photo's area
EDGE = 0.01  # of a range trained on
VERDICTS = ("good", "weak", "not trustworthy")
NAMES = ("tilt", "roll", "field of view", "apparent distortion")
Undistort = Literal["crop", "all", "none"]
Cameras = Literal["each", "one"]


@runtime_checkable
class CalibrationModel(Protocol):
    """A trained network, as far as prediction needs it.

    Attributes:
        input_width, input_height: of the images it takes.
        aspects: of the images it was trained on, before they were squashed.
        spread: half the width of the central 68 % of tilt, roll, vfov (radians) and k1_hat that it was trained on.
        k2_of_k1: its lens family.
    """

    @property
    def input_width(self) -> int: ...  # noqa: D102
    @property
    def input_height(self) -> int: ...  # noqa: D102
    @property
    def aspects(self) -> Sequence[float]: ...  # noqa: D102
    @property
    def spread(self) -> Sequence[float]: ...  # noqa: D102
    @property
    def k2_of_k1(self) -> K2Family: ...  # noqa: D102

    def predict(self, images: Tensor, aspect: Tensor) -> "CalibrationPrediction":
        """Cameras of images of bytes ``(b, 3, h, w)``."""

    def position(self, camera: CameraParameters) -> Tensor:
        """Where each of the four numbers lies along the range trained on, ``(b, 4)``: 0 to 1 inside it."""


class TrainedModel:
    """A calibration module as a :class:`CalibrationModel`."""

    def __init__(self, module: "Calibration"):
        self.module = module.eval()
        spec = module.spec
        self.input_width, self.input_height, self.aspects, self.spread = (
            spec.width, spec.height, spec.aspects, spec.spread,
        )  # fmt: skip
        self.k2_of_k1: K2Family = module.parameterization.k2_of_k1

    def predict(self, images: Tensor, aspect: Tensor) -> "CalibrationPrediction":
        """Cameras of images of bytes, on the module's device."""
        return self.module.predict(images.to(self.module.device), aspect.to(self.module.device))

    def position(self, camera: CameraParameters) -> Tensor:
        """Where each of the four numbers lies along its range."""
        return self.module.space.to_unit(self.module.parameterization.encode(camera))


@dataclass(frozen=True)
class CalibrationOptions:
    """What the user chose; see :data:`KEYS`."""

    undistort: Undistort = "crop"
    camera: Cameras = "each"
    focal_prior: Literal["none", "exif"] | float = "none"


@dataclass
class Finding:
    """A photo's camera while it is put together. Focal length and k1_hat are in heights of the part that was seen.

    Attributes:
        path: of the photo.
        photo: as read, its picture dropped.
        view: the part that the network saw, its picture dropped.
        camera: tilt, roll, focal and k1, float64 scalars.
        half: by level, half the widths of the intervals of tilt, roll, vfov and k1_hat.
        doubts: what speaks against it, each with the verdict it allows at best (an index of ``VERDICTS``).
        basis: what the intervals rest on.
    """

    path: Path
    photo: Photo
    view: NetworkView
    camera: CameraParameters
    half: dict[str, np.ndarray]
    family: K2Family
    doubts: list[tuple[int, str]] = field(default_factory=list)
    basis: str = "conformal"

    @property
    def k2(self) -> Tensor:
        """The second coefficient."""
        return k2_of_k1(self.camera.k1, self.family)

    @property
    def focal_px(self) -> float:
        """Pixels of the upright original."""
        return float(self.camera.focal) * self.view.height

    @property
    def side(self) -> int:
        """The longer side of the original: the unit in which photos of one camera, upright or not, are compared."""
        return max(self.photo.width, self.photo.height)


def options_from(given: Mapping[str, str]) -> CalibrationOptions:
    """Read the keys of :data:`KEYS`.

    Raises:
        UserError: a value is not one of those allowed.
    """
    for key, allowed in (("undistort", get_args(Undistort)), ("camera", get_args(Cameras))):
        if given.get(key, allowed[0]) not in allowed:
            raise UserError(
                f"{key}={given[key]} must be one of {', '.join(allowed)}", f"For example {key}={allowed[0]}"
            )
    text = given.get("focal_prior", "none")
    prior: Any = text
    if text not in ("none", "exif"):
        try:
            prior = float(text)
        except ValueError:
            prior = math.nan
        if not (math.isfinite(prior) and prior > 0):
            raise UserError(
                f"focal_prior={text} must be none, exif or a focal length in pixels above 0", "focal_prior=exif"
            )
    undistort, camera = given.get("undistort", "crop"), given.get("camera", "each")
    return CalibrationOptions(undistort, camera, prior)  # type: ignore[arg-type]  # checked above


def find_photos(given: str, output: Path) -> list[Path]:
    """The photo at a path, all below a folder, or those that a pattern matches, in order; never what this wrote.

    Raises:
        UserError: there is none.
    """
    path = Path(given).expanduser()
    if path.is_file():
        return [path]
    if path.is_dir():
        candidates: Iterable[Path] = path.rglob("*")
    else:
        candidates = (Path(name) for name in glob.glob(str(path), recursive=True))
    written = output.resolve()
    found = sorted(
        p
        for p in candidates
        if p.suffix.lower() in FOUND_IN_FOLDERS
        and p.is_file()
        and not (p.name.endswith(WRITTEN) and p.resolve().is_relative_to(written))
    )
    if not found:
        raise UserError(
            f"input={given}: no photo there",
            f"Give a photo, a folder or a pattern such as 'photos/*.jpg'. Photos end in {', '.join(SUFFIXES)}",
        )
    return found


def predict_calibrations(
    model: CalibrationModel, paths: Sequence[Path], output: Path, options: CalibrationOptions
) -> list[dict[str, Any]]:
    """Calibrate photos, write everything into ``output`` and tell it; a photo that fails is named and the rest go on.

    Raises:
        UserError: not one photo could be calibrated, or they cannot be of one camera.
    """
    output.mkdir(parents=True, exist_ok=True)
    rows: dict[Path, dict[str, Any]] = {path: {"file": str(path)} for path in paths}
    findings = list(_findings(model, list(rows), rows))
    summary = _as_one_camera(findings, options) if options.camera == "one" and findings else None
    if options.camera == "each":
        for finding in findings:
            _use_prior(finding, options)
    sheet = _write_photos(model, findings, rows, output, options)
    _write_all(list(rows.values()), summary, sheet, output)
    _tell(list(rows.values()), summary, output)
    if not findings:
        problem = next(iter(rows.values()))["error"]
        raise UserError(f"none of {len(rows)} photos could be calibrated. The first: {problem}")
    return list(rows.values())


def _findings(model: CalibrationModel, paths: Sequence[Path], rows: dict[Path, dict[str, Any]]) -> Iterable[Finding]:
    """What the network says of each photo. Photos are read one at a time and only the small views are kept."""
    for start in range(0, len(paths), BATCH):
        batch: list[tuple[Path, Photo, NetworkView]] = []
        for path in paths[start : start + BATCH]:
            try:
                photo = read_photo(path)
            except UserError as error:
                rows[path]["error"] = error.problem
                continue
            view = network_view(photo, model.aspects, model.input_width, model.input_height)
            batch.append((path, _without_pixels(photo), view))
        if not batch:
            continue
        images = torch.from_numpy(np.stack([view.image for _, _, view in batch]).transpose(0, 3, 1, 2).copy())
        with torch.no_grad():
            said = model.predict(images, torch.tensor([view.aspect for _, _, view in batch]))
            position = model.position(said.parameters).cpu().double()
        cameras = torch.stack(list(said.parameters), -1).cpu().double()
        half = {name: (said.scale * said.quantile(level)).cpu().double() for name, (level, _) in LEVELS.items()}
        for i, (path, photo, view) in enumerate(batch):
            camera = CameraParameters(*cameras[i].unbind())
            if not (cameras[i].isfinite().all() and camera.focal > 0 and camera.tilt.abs() < math.pi / 2):
                numbers = ", ".join(f"{n}={v:.3g}" for n, v in zip(camera._fields, cameras[i].tolist(), strict=True))
                rows[path]["error"] = f"{path}: what the network predicts is no camera ({numbers})"
                continue
            widths = {name: np.nan_to_num(half[name][i].numpy(), nan=np.inf, posinf=np.inf) for name in LEVELS}
            finding = Finding(path, photo, view, camera, widths, model.k2_of_k1)
            _doubt_view(finding, model, position[i])
            yield finding


def _without_pixels(photo: Photo) -> Photo:
    return Photo(np.zeros((0, 0, 3), np.uint8), photo.width, photo.height, photo.orientation, photo.exif_focal_px)


def _doubt_view(finding: Finding, model: CalibrationModel, position: Tensor) -> None:
    view, photo = finding.view, finding.photo
    if view.share < LITTLE_SEEN:
        finding.doubts.append((1, f"the network saw only {view.share:.0%} of the photo: it has an unusual shape"))
    if view.width < model.input_width or view.height < model.input_height:
        finding.doubts.append(
            (1, f"{photo.width}x{photo.height} pixels are fewer than the {model.input_width}x{model.input_height} that "
                "the network takes")
        )  # fmt: skip
    at_edge = [i for i in range(4) if not EDGE <= position[i] <= 1 - EDGE]
    if at_edge:
        names = ", ".join(
            ("vertical position of the horizon or tilt", "roll", "size", "distortion")[i] for i in at_edge
        )
        finding.doubts.append((1, f"at the end of what the network was trained on: {names}; the truth may lie beyond"))


# -- priors and fusion -------------------------------------------------------------------------------------------------


def _estimate(finding: Finding) -> tuple[np.ndarray, np.ndarray]:
    """Log of the focal length and k1_hat in units of the longer side, with standard errors: half the 68 % intervals."""
    focal, zoom = float(finding.camera.focal), finding.side / finding.view.height
    per_vfov = (4 * focal * focal + 1) / (4 * focal)  # |d ln f / d vfov|
    k1_hat = float(finding.camera.k1) / focal**2
    sigma_vfov, sigma_k1_hat = finding.half["68"][2:]
    sigmas = np.array([sigma_vfov * per_vfov, sigma_k1_hat * zoom**2])
    return np.array([math.log(focal / zoom), k1_hat * zoom**2]), np.maximum(sigmas, 1e-9)


def _adopt(finding: Finding, fusion: Fusion, basis: str) -> None:
    """Put a fused focal length and distortion into a finding, at the same horizon as seen in the picture."""
    zoom = finding.side / finding.view.height
    old = finding.camera
    focal = torch.tensor(math.exp(fusion.values[0]) * zoom, dtype=torch.float64)
    k1 = fusion.values[1] / zoom**2 * focal.square()
    rho = rho_from_tilt(old.tilt, old.focal, old.k1, finding.k2)
    tilt = tilt_from_rho(rho, focal, k1, k2_of_k1(k1, finding.family))
    per_log_focal = 4 * float(focal) / (4 * float(focal) ** 2 + 1)
    finding.camera = CameraParameters(tilt, old.roll, focal, k1)
    for name, (_, multiple) in LEVELS.items():
        fused = fusion.sigmas * multiple * np.array([per_log_focal, zoom**-2])
        finding.half[name] = np.concatenate([finding.half[name][:2], fused])
    finding.basis = basis


def _prior(finding: Finding, options: CalibrationOptions) -> Prior | None:
    if options.focal_prior == "exif":
        known = finding.photo.exif_focal_px
        return Prior(math.log(known / finding.side), PRIOR_SIGMA["exif"]) if known else None
    if options.focal_prior == "none":
        return None
    return Prior(math.log(float(options.focal_prior) / finding.side), PRIOR_SIGMA["given"])


def _doubt_prior(z: float, source: str) -> tuple[int, str]:
    return 1, f"the focal length by {source} and the picture disagree by {abs(z):.1f} standard errors"


def _use_prior(finding: Finding, options: CalibrationOptions) -> None:
    prior = _prior(finding, options)
    known = finding.photo.exif_focal_px
    if prior is None:
        if options.focal_prior == "exif":
            finding.doubts.append((0, "EXIF tells no focal length: none was used"))
        elif known:
            low, high = _focal_interval(finding, "95")
            if not low <= known <= high:
                finding.doubts.append((1, f"EXIF tells a focal length of {known:.0f} px, outside the 95 % interval"))
        return
    values, sigmas = _estimate(finding)
    if not np.isfinite(sigmas).all():
        finding.doubts.append((2, "the focal length of the prior was not used: the network gives no interval"))
        return
    fusion = with_prior(fuse(values[None], sigmas[None]), 0, prior)
    _adopt(finding, fusion, f"focal_prior={options.focal_prior}, normal")
    if abs(fusion.prior_z) > PRIOR_DISAGREES:
        finding.doubts.append(_doubt_prior(fusion.prior_z, f"focal_prior={options.focal_prior}"))


def _as_one_camera(findings: Sequence[Finding], options: CalibrationOptions) -> dict[str, Any]:
    """Fuse focal length and distortion of all photos, and put them into each that agrees."""
    _check_one_camera(findings, options)
    estimates = [_estimate(finding) for finding in findings]
    values, sigmas = (np.stack(column) for column in zip(*estimates, strict=True))
    if not np.isfinite(sigmas).any(0).all():
        raise UserError("camera=one: the network gives no intervals, without which nothing can be fused", "camera=each")
    fusion = fuse(values, sigmas)
    priors = [prior for finding in findings if (prior := _prior(finding, options))]
    doubts: list[str] = []
    if priors:
        means = np.array([prior.mean for prior in priors])
        if np.ptp(means) > 2 * priors[0].sigma:
            doubts.append("EXIF tells focal lengths that differ: a zoom lens is another camera at each setting")
        fusion = with_prior(fusion, 0, Prior(float(np.median(means)), priors[0].sigma))
        if abs(fusion.prior_z) > PRIOR_DISAGREES:
            doubts.append(_doubt_prior(fusion.prior_z, f"focal_prior={options.focal_prior}")[1])
    if not fusion.consistent:
        doubts.append(
            f"the photos disagree more than their intervals allow (p = {fusion.p_value:.2g}): are they of one camera?"
        )
    for finding, kept in zip(findings, fusion.kept, strict=True):
        if kept:
            _adopt(finding, fusion, f"fused over {int(fusion.kept.sum())} photos, normal")
            finding.doubts += [(1, text) for text in doubts]
        else:
            finding.doubts.append((1, "left out of the fusion: it disagrees with the other photos"))
    return {
        "photos": len(findings),
        "kept": [str(f.path) for f, kept in zip(findings, fusion.kept, strict=True) if kept],
        "left_out": [str(f.path) for f, kept in zip(findings, fusion.kept, strict=True) if not kept],
        "focal_of_longer_side": math.exp(fusion.values[0]),
        "focal_log_sigma": float(fusion.sigmas[0]),
        "k1_hat_of_longer_side": float(fusion.values[1]),
        "k1_hat_sigma": float(fusion.sigmas[1]),
        "chi_square": fusion.chi_square,
        "degrees_of_freedom": fusion.degrees,
        "p_value": fusion.p_value,
        "consistent": fusion.consistent,
        "prior_z": fusion.prior_z,
        "doubts": doubts,
    }


def _check_one_camera(findings: Sequence[Finding], options: CalibrationOptions) -> None:
    shapes = {f.path: f.side / min(f.photo.width, f.photo.height) for f in findings}
    first, last = min(shapes, key=lambda p: shapes[p]), max(shapes, key=lambda p: shapes[p])
    if shapes[last] / shapes[first] - 1 > SAME_SHAPE:
        raise UserError(
            f"camera=one: {first} and {last} have sides of 1:{shapes[first]:.3f} and 1:{shapes[last]:.3f}, so that one "
            "of them was cropped or is of another camera",
            "Take it out, or calibrate each photo by itself: camera=each",
        )
    sides = {finding.side for finding in findings}
    if isinstance(options.focal_prior, float) and len(sides) > 1:
        raise UserError(
            f"camera=one focal_prior={options.focal_prior:g}: the photos have longer sides of {min(sides)} to "
            f"{max(sides)} pixels, so that their focal lengths in pixels differ",
            "Give photos of one size, or focal_prior=exif",
        )


# -- what is told ------------------------------------------------------------------------------------------------------


def _focal_interval(finding: Finding, level: str) -> tuple[float, float]:
    """Pixels of the original; 0 and infinity where the interval of the field of view has no end."""
    vfov, half = float(vfov_from_focal(finding.camera.focal)), finding.half[level][2]
    wide, narrow = vfov + half, vfov - half
    low = float(focal_from_vfov(torch.tensor(wide, dtype=torch.float64))) if wide < math.pi else 0.0
    high = float(focal_from_vfov(torch.tensor(narrow, dtype=torch.float64))) if narrow > 0 else math.inf
    return low * finding.view.height, high * finding.view.height


def _intervals(finding: Finding, level: str) -> dict[str, list[float]]:
    camera, height = finding.camera, finding.photo.height
    half = finding.half[level]
    k1_hat = float(camera.k1 / camera.focal.square())
    focal = _focal_interval(finding, level)
    vfov = [math.degrees(2 * math.atan2(height / 2, f)) for f in reversed(focal)]
    angles = {
        f"{name}_deg": [math.degrees(value - h), math.degrees(value + h)]
        for name, value, h in (("tilt", float(camera.tilt), half[0]), ("roll", float(camera.roll), half[1]))
    }
    k1 = [float((k1_hat + sign * half[3]) * camera.focal.square()) for sign in (-1, 1)]
    return angles | {"focal_px": list(focal), "vfov_deg": vfov, "k1": k1}


def _confidence(finding: Finding, spread: Sequence[float]) -> dict[str, Any]:
    ratios = finding.half["68"] / np.asarray(spread)
    verdict, reasons = 0, []
    for i, (name, ratio) in enumerate(zip(NAMES, ratios, strict=True)):
        if ratio > GOOD:
            verdict = max(verdict, 2 if ratio > TRUSTWORTHY else 1)
            half, known, unit = finding.half["68"][i], spread[i], ""
            if i < 3:
                half, known, unit = math.degrees(half), math.degrees(known), "°"
            wider = "wider than the" if ratio > TRUSTWORTHY else "more than half of the"
            reasons.append(
                f"{name}: 68 % interval ±{half:.2g}{unit}, {wider} ±{known:.2g}{unit} of all cameras trained on"
            )
    for worst, text in finding.doubts:
        verdict = max(verdict, worst)
        reasons.append(text)
    return {"verdict": VERDICTS[verdict], "width_over_training_spread": dict(zip(NAMES, ratios.tolist(), strict=True)),
            "reasons": reasons}  # fmt: skip


def _row(finding: Finding, model: CalibrationModel) -> dict[str, Any]:
    camera, photo, view = finding.camera, finding.photo, finding.view
    focal, width, height = finding.focal_px, photo.width, photo.height
    k1, k2 = float(camera.k1), float(finding.k2)
    ends = torch.tensor([width, height], dtype=torch.float64) / 2 / focal
    true = torch.rad2deg(2 * torch.atan(undistort_radius(ends, camera.k1, finding.k2))).tolist()
    return {
        "width": width,
        "height": height,
        "exif_orientation": photo.orientation,
        "tilt_deg": math.degrees(camera.tilt),
        "roll_deg": math.degrees(camera.roll),
        "focal_px": focal,
        "vfov_deg": math.degrees(2 * math.atan(height / 2 / focal)),
        "true_vfov_deg": true[1],
        "true_hfov_deg": true[0],
        "k1": k1,
        "k2": k2,
        "k1_hat": k1 * (height / focal) ** 2,
        "intervals": {level: _intervals(finding, level) for level in LEVELS},
        "intervals_by": finding.basis,
        "exif_focal_px": photo.exif_focal_px,
        "confidence": _confidence(finding, model.spread),
        "opencv": {
            "matrix": [[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]],
            "distortion": [k1, k2, 0, 0, 0],
        },
        "colmap": {"model": "RADIAL", "parameters": [focal, width / 2, height / 2, k1, k2]},
        "seen": {"left": view.left, "top": view.top, "width": view.width, "height": view.height, "share": view.share},
        "units": "pixels of the upright original (after EXIF orientation); tilt > 0 looks up; vfov_deg is nominal, "
        "2 atan(height / 2 f), true_* are with distortion; k1_hat is k1 / f² in heights of the photo; "
        "the interval of k1 is at this focal length",
    }


def _caption(row: Mapping[str, Any]) -> list[str]:
    widths = row["intervals"]["68"]

    def half(key: str, unit: str) -> str:
        width = (widths[key][1] - widths[key][0]) / 2
        return f"±{width:.2g}{unit}" if math.isfinite(width) else "±?"

    return [
        f"{Path(row['file']).name}: {row['confidence']['verdict']}",
        f"tilt {row['tilt_deg']:+.1f}°{half('tilt_deg', '°')}, roll {row['roll_deg']:+.1f}°{half('roll_deg', '°')}",
        f"field of view {row['vfov_deg']:.1f}°{half('vfov_deg', '°')}, k1 {row['k1']:+.3f}{half('k1', '')}",
    ]


def _overlaid(finding: Finding, image: np.ndarray, row: Mapping[str, Any]) -> "CalibratedPhoto":
    from sextant.figures.calibration_overlay import CalibratedPhoto

    camera, photo, view = finding.camera, finding.photo, finding.view
    seen = (view.left / photo.width, view.top / photo.height, view.width / photo.width, view.height / photo.height)
    return CalibratedPhoto(
        image, float(camera.tilt), float(camera.roll), finding.focal_px / photo.height, float(camera.k1),
        float(finding.k2), seen, _caption(row),
    )  # fmt: skip


def _write_photos(
    model: CalibrationModel,
    findings: Sequence[Finding],
    rows: dict[Path, dict[str, Any]],
    output: Path,
    options: CalibrationOptions,
) -> "list[CalibratedPhoto]":
    from PIL import Image

    from sextant.figures.calibration_overlay import LONGEST_SIDE, calibration_overlay
    from sextant.figures.style import save_figure

    sheet: list[CalibratedPhoto] = []
    for finding, stem in zip(findings, _stems([finding.path for finding in findings]), strict=True):
        row = rows[finding.path]
        row |= _row(finding, model)
        image = read_photo(finding.path).image  # again, so that never more than one photo is in memory
        scale = image.shape[0] / finding.photo.height
        if options.undistort != "none":
            kind = "jpg" if finding.path.suffix.lower() in (".jpg", ".jpeg") else "png"
            name = f"{stem}_undistorted.{kind}"
            straight, focal = undistort_photo(image, finding.focal_px * scale, row["k1"], row["k2"], options.undistort)
            _save(Image.fromarray(straight), output / name, kind)
            row["undistorted"] = {
                "file": name, "focal_px": focal, "width": straight.shape[1], "height": straight.shape[0],
                "kept": options.undistort,
            }  # fmt: skip
            del straight
        small = Image.fromarray(image)
        small.thumbnail((LONGEST_SIDE, LONGEST_SIDE), Image.Resampling.BOX)
        overlaid = _overlaid(finding, np.asarray(small), row)
        save_figure(calibration_overlay(overlaid), output, f"{stem}_overlay")
        write_json(output / f"{stem}.json", row)
        if len(sheet) < SHEET:
            sheet.append(overlaid)
    return sheet


def _save(image: Any, path: Path, kind: str) -> None:
    buffer = io.BytesIO()
    options = {"quality": 95, "subsampling": 0} if kind == "jpg" else {"compress_level": 3}
    image.save(buffer, "JPEG" if kind == "jpg" else "PNG", **options)
    write_atomically(path, lambda file: file.write(buffer.getbuffer()))


def _stems(paths: Sequence[Path]) -> list[str]:
    """A name for the files of each photo: its own without suffix; with suffix, folder or a number if that is taken."""
    taken: set[str] = set()
    stems = []
    for path in paths:
        wished = [path.stem, f"{path.stem}_{path.suffix[1:]}", f"{path.parent.name}_{path.stem}"]
        numbered = (f"{path.stem}_{i}" for i in range(2, len(paths) + 2))
        stem = next(name for name in (*wished, *numbered) if name.lower() not in taken)
        taken.add(stem.lower())  # file systems may not tell upper from lower case
        stems.append(stem)
    return stems


COLUMNS = (
    "file", "verdict", "tilt_deg", "roll_deg", "focal_px", "vfov_deg", "true_vfov_deg", "true_hfov_deg", "k1", "k2",
    "width", "height", "exif_focal_px", "error",
)  # fmt: skip


def _write_all(
    rows: Sequence[dict[str, Any]], summary: dict[str, Any] | None, sheet: "list[CalibratedPhoto]", output: Path
) -> None:
    from sextant.figures.calibration_overlay import calibration_sheet
    from sextant.figures.style import save_figure

    write_json(output / "calibrations.json", {"photos": list(rows), "camera": summary})
    table = io.StringIO()
    bounds = [(q, level) for q in ("tilt_deg", "roll_deg", "focal_px", "vfov_deg", "k1") for level in LEVELS]
    names = [f"{q}_{level}_{end}" for q, level in bounds for end in ("low", "high")]
    writer = csv.DictWriter(table, [*COLUMNS, *names], extrasaction="ignore", restval="")
    writer.writeheader()
    for row in rows:
        flat = dict(row)
        if "intervals" in row:
            flat["verdict"] = row["confidence"]["verdict"]
            for quantity, level in bounds:
                for end, value in zip(("low", "high"), row["intervals"][level][quantity], strict=True):
                    flat[f"{quantity}_{level}_{end}"] = value if math.isfinite(value) else ""
        writer.writerow(flat)
    write_atomically(output / "calibrations.csv", lambda file: file.write(table.getvalue().encode()))
    if sheet:
        save_figure(calibration_sheet(sheet), output, "calibrations")


def _tell(rows: Sequence[dict[str, Any]], summary: dict[str, Any] | None, output: Path) -> None:
    good = [row for row in rows if "error" not in row]
    if good:
        table = [
            {"photo": Path(row["file"]).name, "tilt °": f"{row['tilt_deg']:+.1f}", "roll °": f"{row['roll_deg']:+.1f}",
             "focal px": f"{row['focal_px']:.0f}", "vfov °": f"{row['vfov_deg']:.1f}", "k1": f"{row['k1']:+.3f}",
             "trust": row["confidence"]["verdict"]}
            for row in good
        ]  # fmt: skip
        console.print(rows_table("Cameras", table))
    for row in rows:
        for reason in row.get("confidence", {}).get("reasons", ()):
            console.print(f"[dim]{escape(Path(row['file']).name)}: {escape(reason)}[/]")
        if "error" in row:
            console.print(f"[red]{escape(row['error'])}[/]")
    if summary:
        console.print(
            f"One camera from {len(summary['kept'])} of {summary['photos']} photos: "
            f"chi-square {summary['chi_square']:.1f} with {summary['degrees_of_freedom']} degrees of freedom, "
            f"p = {summary['p_value']:.2g}"
        )
    failed = len(rows) - len(good)
    console.print(f"{len(good)} photos calibrated" + (f", [red]{failed} failed[/]" if failed else ""))
    console.print(escape("\n".join(f"{output}/calibrations.{kind}" for kind in ("csv", "json", "png"))))
