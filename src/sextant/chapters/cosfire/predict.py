"""From one example and a folder of images to files of detections."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jaxtyping import Float
from numpy import ndarray

from sextant.applications.write_errors import telling_write_errors
from sextant.atomic_files import write_csv, write_json
from sextant.chapters.cosfire.detector import Detection, ExampleDetector
from sextant.chapters.cosfire.detector_options import PHOTO
from sextant.chapters.cosfire.figures import cosfire_filter, cosfire_responses
from sextant.chapters.cosfire.images import UprightImage, read_image
from sextant.chapters.cosfire.network_image import TrainedFeatures
from sextant.chapters.cosfire.options import DetectionInputs
from sextant.console.console import console, rows_table
from sextant.console.work_progress import work_progress
from sextant.console.written import skipped_of, tell_skipped, tell_written
from sextant.data.photo_files import file_stems
from sextant.errors import NAMED, UserError
from sextant.figures.style import save_figure
from sextant.tables import counted

COLUMNS = ("file", "x", "y", "score")
MOVE_COLUMNS = ("rotation_deg", "scale", "mirrored")


def write_detections(rows: Sequence[Mapping[str, Any]], facts: Mapping[str, Any], output: Path) -> None:
    """Write ``detections.csv``, a row per detection or unreadable image, and ``detections.json``.

    Args:
        rows: one per image: its file, size and detections, or its error.
        facts: facts of the filter, for ``detections.json``.
        output: folder to write into.

    Raises:
        UserError: the disk is full, or the folder cannot be written to.
    """
    with telling_write_errors(output):
        write_json(output / "detections.json", {**facts, "images": list(rows)})
        lines = list(_lines(rows))
        moves = MOVE_COLUMNS if any("scale" in line for line in lines) else ()
        write_csv(output / "detections.csv", [*COLUMNS, *moves, "error"], lines)


def filter_facts(detector: ExampleDetector, source: Mapping[str, Any]) -> dict[str, Any]:
    """The filter of a detector with one example, as plain values.

    Args:
        detector: detector with its example.
        source: what the filter operates on: a preset, or a run and its layer.
    """
    (example,) = detector.examples
    across, down = example.image.ratios
    return {
        **source,
        "x": round((example.point[0] + 0.5) / across - 0.5, 2),
        "y": round((example.point[1] + 0.5) / down - 0.5, 2),
        "parts": example.parts,
        "own_response": example.own,
        "tolerance": asdict(detector.filters.tolerance),
        "prototype_scale": across,
    }


def _lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    for row in rows:
        if "error" in row:
            yield {"file": row["file"], "error": row["error"]}
        for found in row.get("detections", ()):
            yield {"file": row["file"], **found}


#: name of the prototype's picture, which later commands do not mistake for an input
FILTER_PICTURE = "filter_overlay"
#: remark on images too small for a filter
SMALLER = "smaller than the filter"
#: ratio of sizes above which a difference is mentioned
OTHER_SIZE = 1.25


def predict_detections(inputs: DetectionInputs, network: TrainedFeatures | None = None) -> list[dict[str, Any]]:
    """Configure a filter, detect, write the results to ``output`` and show them; unreadable images are listed.

    Args:
        inputs: example, images and options.
        network: network whose features are used; None uses the filter bank of a preset.

    Raises:
        UserError: no filter can be configured from the example, not one image could be used, or the disk is full.
    """
    options, output = inputs.options, inputs.output
    chosen = options.model_dump(include={"preset", "rotations", "scales", "reflection", "longest"})
    detector = ExampleDetector(network, **chosen).add(inputs.prototype, options.point)
    detector.threshold = options.threshold or detector.threshold
    (example,) = detector.examples
    with telling_write_errors(output):
        pixels, title = example.image.tensor(detector.channels), f"{inputs.prototype.name}: {example.parts} parts"
        save_figure(cosfire_filter(detector.filters, pixels, example.point, title=title), output, FILTER_PICTURE)
    rows: list[dict[str, Any]] = []
    scales: list[float] = []
    with work_progress("detecting", "images") as progress:
        stems = file_stems(inputs.paths, [FILTER_PICTURE.removesuffix("_overlay")])
        for number, (path, stem) in enumerate(zip(inputs.paths, stems, strict=True)):
            progress(number, len(inputs.paths))
            try:
                image = read_image(path, options.longest)
                response, found = detector.find(
                    image, min_distance=options.min_distance, max_detections=options.max_detections
                )
            except UserError as error:
                rows.append({"file": str(path), "error": error.problem})
                continue
            scales.append(image.scale)
            _draw(image, response, found, output, f"{stem}_overlay")
            rows.append(
                {
                    "file": str(path),
                    **({} if found or min(response.shape) > 2 * detector.radius else {"remark": SMALLER}),
                    "width": image.width,
                    "height": image.height,
                    "strongest": round(float(response.max()), 4),
                    "detections": [each.row() for each in found],
                    "overlay": f"{stem}_overlay.png",
                }
            )
    facts = options.model_dump(include={"min_distance", "max_detections", "longest"}) | {
        "prototype": str(inputs.prototype),
        "filter": filter_facts(detector, {"preset": options.preset or PHOTO} if network is None else network.facts),
        "threshold": detector.threshold,
    }
    write_detections(rows, facts, output)
    skipped = skipped_of(rows, f"none of {counted(len(rows), 'image')} could be used")
    written = [output / "detections.csv", output / "detections.json", output / f"{FILTER_PICTURE}.png"]
    tell(rows, skipped, _remarks(rows, facts["filter"], example.image, scales, inputs), written)
    return rows


def _draw(
    image: UprightImage, response: Float[ndarray, "y x"], found: Sequence[Detection], output: Path, name: str
) -> None:
    points = [(*image.at((each.x, each.y)), each.score) for each in found]
    with telling_write_errors(output):
        drawn = cosfire_responses(image.picture, response, points, strongest=1.0, title=Path(image.name).name)
        save_figure(drawn, output, name)


def _remarks(
    rows: Sequence[Mapping[str, Any]],
    facts: Mapping[str, Any],
    prototype: UprightImage,
    shrunk: Sequence[float],
    inputs: DetectionInputs,
) -> list[str]:
    remarks = ["a score of 1 is the filter's response to its own prototype"]
    if "run" not in facts:
        remarks[0] += "; it falls with contrast"  # kernel responses are proportional to contrast, cosines are not
    if small := sum(row.get("remark") == SMALLER for row in rows):
        remarks.append(
            f"{counted(small, 'image is', 'images are')} smaller than the filter, so nothing can be detected in them"
        )
    other = sum(max(scale / prototype.scale, prototype.scale / scale) > OTHER_SIZE for scale in shrunk)
    if other:
        remarks.append(
            f"{counted(other, 'image was', 'images were')} shrunk to longest={inputs.options.longest} by another "
            "factor than the prototype, which changes the sizes of objects: set longest= to the largest side, or "
            "scales="
        )
    return remarks


def tell(
    rows: Sequence[Mapping[str, Any]], skipped: Mapping[str, str], remarks: Sequence[str], written: Sequence[Path]
) -> None:
    """Print what was found, which images failed, remarks on the scores, and where the files are."""
    good = [row for row in rows if row["file"] not in skipped]
    ordered = sorted(good, key=_best, reverse=True)
    table = [
        {
            "image": Path(row["file"]).name,
            "found": f"{len(row['detections']):,}",
            "best score": f"{_best(row):.2f}" if row["detections"] else "–",
        }
        for row in ordered[:NAMED]
    ]
    console.print(rows_table("Detections", table))
    if len(ordered) > NAMED:
        console.print(f"[dim]and {len(ordered) - NAMED:,} more in detections.json[/]")
    tell_skipped(skipped)
    for remark in remarks:
        console.print(remark, style="dim", markup=False)
    total = sum(len(row["detections"]) for row in good)
    tell_written(f"{counted(total, 'detection')} in {counted(len(good), 'image')}", len(skipped), written)


def _best(row: Mapping[str, Any]) -> float:
    return max((float(found["score"]) for found in row["detections"]), default=0.0)
