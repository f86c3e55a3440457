"""From one example and a folder of images to files of detections."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.applications.detection.detector import Detector
from sextant.applications.detection.filters import NETWORK_THRESHOLD, THRESHOLD, network_filter, preset_filter
from sextant.applications.detection.images import UprightImage, read_image
from sextant.applications.detection.options import PHOTO
from sextant.cli.cosfire_detection.inputs import DetectionInputs, check_point
from sextant.cli.cosfire_detection.telling import tell
from sextant.cli.cosfire_detection.written_files import write_detections
from sextant.cli.output_folder import telling_write_errors
from sextant.cli.photo_calibration.file_names import file_stems
from sextant.cli.skipped_files import skipped_of
from sextant.cli.work_progress import work_progress
from sextant.errors import UserError
from sextant.figures.cosfire.filter import cosfire_filter
from sextant.figures.cosfire.responses import cosfire_responses
from sextant.figures.style import save_figure

if TYPE_CHECKING:
    from sextant.applications.detection.network import TrainedFeatures

#: the prototype's picture; its name is one that later commands do not take for an input
FILTER_PICTURE = "filter_overlay"
#: of images in which a filter has no room
SMALLER = "smaller than the filter"
#: sizes that differ by more are told of
OTHER_SIZE = 1.25


def predict_detections(inputs: DetectionInputs, network: "TrainedFeatures | None" = None) -> list[dict[str, Any]]:
    """Configure a filter, find, write everything into ``output`` and tell it; what cannot be read is named.

    Args:
        inputs: see there.
        network: whose features are looked at; None looks through a preset's filters.

    Raises:
        UserError: no filter can be made of the example, not one image could be used, or the disk is full.
    """
    options, output = inputs.options, inputs.output
    prototype = read_image(inputs.prototype, options.longest)
    if options.point is not None:
        check_point(options.point, (prototype.width, prototype.height))
    detector = _configured(inputs, prototype, network)
    threshold = options.threshold or (THRESHOLD if network is None else NETWORK_THRESHOLD)
    with telling_write_errors(output):
        example = prototype.tensor(detector.channels)
        told = f"{inputs.prototype.name}: {detector.parts} parts"
        save_figure(cosfire_filter(detector.filters, example, detector.point, title=told), output, FILTER_PICTURE)
    rows: list[dict[str, Any]] = []
    shrunk: list[float] = []
    with work_progress("detecting", "images") as progress:
        # the first name is taken by the filter's picture
        stems = file_stems([Path(FILTER_PICTURE.removesuffix("_overlay")), *inputs.paths])[1:]
        for number, (path, stem) in enumerate(zip(inputs.paths, stems, strict=True)):
            progress(number, len(inputs.paths))
            rows.append(_row(path, stem, detector, inputs, threshold, shrunk.append))
    facts: dict[str, Any] = {
        "prototype": str(inputs.prototype),
        "filter": _filter_facts(detector, prototype, inputs, network),
        "threshold": threshold,
        "min_distance": options.min_distance,
        "max_detections": options.max_detections,
        "longest": options.longest,
    }
    write_detections(rows, facts, output)
    skipped = skipped_of(rows, f"none of {len(rows):,} images could be used")
    written = [output / "detections.csv", output / "detections.json", output / f"{FILTER_PICTURE}.png"]
    tell(rows, skipped, _remarks(rows, facts["filter"], prototype, shrunk, inputs), written)
    return rows


def _configured(inputs: DetectionInputs, prototype: UprightImage, network: "TrainedFeatures | None") -> Detector:
    options = inputs.options
    if network is None:
        filters, channels = preset_filter(options), 1
    else:
        filters, channels = network_filter(network.features, network.size, options), network.channels
    try:
        return Detector(filters, prototype, options.point, channels)
    except UserError as error:
        size = prototype.picture.shape
        where = "" if prototype.scale == 1 else f" (shrunk to {size[1]}x{size[0]} pixels)"
        raise UserError(f"prototype={inputs.prototype}{where}: {error.problem}", error.fix) from None


def _row(
    path: Path,
    stem: str,
    detector: Detector,
    inputs: DetectionInputs,
    threshold: float,
    note_scale: Callable[[float], object],
) -> dict[str, Any]:
    """What is found in one image, drawn as well; or why it cannot be used."""
    options, row = inputs.options, {"file": str(path)}
    try:
        image = read_image(path, options.longest)
        response, found = detector.find(
            image, threshold=threshold, min_distance=options.min_distance, most=options.max_detections
        )
    except UserError as error:
        return row | {"error": error.problem}
    note_scale(image.scale)
    points = [(*image.at((each.x, each.y)), each.score) for each in found]
    with telling_write_errors(inputs.output):
        drawn = cosfire_responses(image.picture, response, points, strongest=1.0, title=path.name)
        save_figure(drawn, inputs.output, f"{stem}_overlay")
    if not found and min(response.shape) <= 2 * detector.radius:
        row["remark"] = SMALLER
    return row | {
        "width": image.width,
        "height": image.height,
        "strongest": round(float(response.max()), 4),
        "detections": [each.row() for each in found],
        "overlay": f"{stem}_overlay.png",
    }


def _filter_facts(
    detector: Detector, prototype: UprightImage, inputs: DetectionInputs, network: "TrainedFeatures | None"
) -> Mapping[str, Any]:
    filters, (x, y) = detector.filters, detector.point
    source = {"preset": inputs.options.preset or PHOTO} if network is None else dict(network.facts)
    return source | {
        "x": round((x + 0.5) / prototype.scale - 0.5, 2),
        "y": round((y + 0.5) / prototype.scale - 0.5, 2),
        "parts": detector.parts,
        "own_response": detector.own,
        "tolerance": asdict(filters.tolerance),
        "prototype_scale": prototype.scale,
    }


def _remarks(
    rows: Sequence[Mapping[str, Any]],
    facts: Mapping[str, Any],
    prototype: UprightImage,
    shrunk: Sequence[float],
    inputs: DetectionInputs,
) -> list[str]:
    told = ["a score of 1 is what the filter answers to its own prototype"]
    if "run" not in facts:
        told[0] += "; it falls with contrast"  # responses of kernels are proportional to it, cosines are not
    if small := sum(row.get("remark") == SMALLER for row in rows):
        told.append(f"{small:,} images are smaller than the filter, and nothing was found in them")
    other = sum(max(scale / prototype.scale, prototype.scale / scale) > OTHER_SIZE for scale in shrunk)
    if other:
        told.append(
            f"{other:,} images were shrunk to longest={inputs.options.longest} by another factor than the prototype, "
            "so that things in them are of other sizes: give longest= the largest side, or scales="
        )
    return told
