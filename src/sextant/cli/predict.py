"""``predict.py``: classify images with a trained model."""

import csv
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sextant.cli.arguments import parse_arguments
from sextant.cli.compose import default_outputs
from sextant.cli.console import console
from sextant.cli.evaluate import checkpoint_config
from sextant.cli.resolve import resolve_run
from sextant.data.image_folder import SUFFIXES, decode_square
from sextant.errors import UserError
from sextant.tracking.environment import quiet_libraries

USAGE = "python predict.py run=<MLflow run id, run directory or checkpoint> input=<image or folder> output=<folder>"
KEYS = {
    "run": "the trained model",
    "input": "an image, or a folder that is searched for images",
    "output": "folder for predictions.csv, predictions.json and predictions.png",
    "outputs": "output folder of runs, if not the default",
    "trust": "true: build parts of the user's own that the checkpoint names",
}
BATCH = 256
SHEET = 40


def main(arguments: Sequence[str]) -> None:
    """Classify every image of a folder; one that cannot be read is named in the result and the rest go on."""
    quiet_libraries()
    given = parse_arguments(arguments, KEYS, USAGE)
    for key in ("run", "input", "output"):
        if key not in given:
            raise UserError(f"{key}= is missing", USAGE)
    paths = find_images(Path(given["input"]).expanduser())
    output = Path(given["output"]).expanduser()
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"output={output} is not a folder that can be written to: {error.strerror}") from None
    outputs = Path(given["outputs"]).absolute() if "outputs" in given else default_outputs()
    found = resolve_run(given["run"], outputs)
    rows, pictures = _classify(paths, found.checkpoint, given.get("trust") == "true")
    _write(rows, output)
    _sheet(pictures, output)
    failed = sum("error" in row for row in rows)
    console.print(
        f"{len(rows) - failed} images classified" + (f", [red]{failed} could not be read[/]" if failed else "")
    )
    console.print(f"{output}/predictions.csv\n{output}/predictions.json\n{output}/predictions.png")


def find_images(path: Path) -> list[Path]:
    """The image at ``path``, or all images below it in order.

    Raises:
        UserError: there is none.
    """
    if path.is_file():
        return [path]
    found = sorted(p for p in path.rglob("*") if p.suffix.lower() in SUFFIXES) if path.is_dir() else []
    if not found:
        raise UserError(f"input={path}: no image there", f"Images end in {', '.join(SUFFIXES)}")
    return found


def _classify(
    paths: list[Path], checkpoint: Path, trust: bool
) -> tuple[list[dict[str, Any]], list[tuple[np.ndarray, str]]]:
    import torch

    from sextant.cli.families.classification import image_spec
    from sextant.cli.training import model_from_checkpoint
    from sextant.runs.checkpoint import KEY, load_checkpoint

    content = load_checkpoint(checkpoint)
    spec = image_spec(content[KEY]["spec"])
    if spec.height != spec.width:
        raise UserError(f"{checkpoint} takes images of {spec.height}x{spec.width}; only square ones are cropped to fit")
    raw, config = checkpoint_config(content[KEY], ["trust=true"] if trust else [])
    module = model_from_checkpoint(raw, config, checkpoint)
    rows: list[dict[str, Any]] = []
    pictures: list[tuple[np.ndarray, str]] = []
    for batch in _batches(paths):
        images: list[np.ndarray] = []
        entries: list[dict[str, Any]] = []
        for path in batch:
            entry: dict[str, Any] = {"file": str(path)}
            rows.append(entry)
            try:
                images.append(decode_square(path, spec.height, spec.channels))
                entries.append(entry)
            except UserError as error:
                entry["error"] = error.problem
        if not images:
            continue
        stacked = np.stack(images)
        stacked = stacked[:, None] if stacked.ndim == 3 else stacked.transpose(0, 3, 1, 2)
        with torch.no_grad():
            probabilities = module.predict_step(torch.from_numpy(stacked.copy()).float() / 255)
        for entry, image, chances in zip(entries, images, probabilities, strict=True):
            best = int(chances.argmax())
            entry |= {"class": spec.classes[best], "probability": round(float(chances[best]), 6)}
            entry["probabilities"] = {n: round(float(p), 6) for n, p in zip(spec.classes, chances, strict=True)}
            if len(pictures) < SHEET:
                pictures.append((image, f"{spec.classes[best]} {float(chances[best]):.2f}"))
    return rows, pictures


def _batches(paths: list[Path]) -> Iterator[list[Path]]:
    for start in range(0, len(paths), BATCH):
        yield paths[start : start + BATCH]


def _write(rows: list[dict[str, Any]], output: Path) -> None:
    (output / "predictions.json").write_text(json.dumps(rows, indent=2) + "\n")
    with (output / "predictions.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, ["file", "class", "probability", "error"], extrasaction="ignore", restval="")
        writer.writeheader()
        writer.writerows(rows)


def _sheet(pictures: list[tuple[np.ndarray, str]], output: Path) -> None:
    from sextant.figures.gallery import gallery
    from sextant.figures.style import save_figure

    if pictures:
        save_figure(gallery([image for image, _ in pictures], [text for _, text in pictures]), output, "predictions")
