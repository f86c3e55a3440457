"""Put a trained run into the zoo: ``python -m benchmarks.zoo_model run=<run> name=<name> card=<json>``.

A calibration model also needs ``intervals=<run>``, a calibration run that held out panoramas on which the shipped
network was trained. The statistics for intervals and the appearance of photos are measured with it on these panoramas,
40 crops of each, which count as independent. The map of a localization run goes beside its weights, without pictures.
"""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sextant.chapters.calibration.network import CameraNetwork, reported, trained_camera_network
from sextant.chapters.localization.found_map import find_map
from sextant.chapters.localization.localizer_folder import PICTURES
from sextant.chapters.places.saved_map import FITTED
from sextant.config import validate
from sextant.console.arguments import parse_arguments
from sextant.kit.trained import own_config, read_trained
from sextant.registry import chapter_of
from sextant.runs.checkpoint import KEY
from sextant.runs.outputs_folder import default_outputs
from sextant.runs.resolve import resolve_run
from sextant.zoo import write_model

KEYS = {
    "run": "its directory or checkpoint",
    "name": "of the model",
    "card": "JSON with the facts of the card: data, licences, command, metrics, seeds, hardware, date",
    "intervals": "for calibration: the run whose validation panoramas give the intervals",
    "outputs": "folder of runs",
}
USAGE = "python -m benchmarks.zoo_model run=<run> name=<name> card=<facts.json> [intervals=<run>]"
CROPS = 40  # per panorama
#: config nodes that describe the machine of a run, which are not published
ANYWHERE = {"paths": {"data": "data", "outputs": "outputs", "cache": "data"}}


def without_places(config: dict[str, Any]) -> dict[str, Any]:
    """A config without the folders and the GPU of the machine that it was run on."""
    for source in config["dataset"].get("sources", {}).values():
        if "folder" in source:
            source["folder"] = Path(source["folder"]).name
    trainer = {**config["trainer"], "accelerator": "cpu"}
    return {**config, **ANYWHERE, "trainer": trainer, "init_from": None}


@torch.no_grad()
def measured(path: Path) -> dict[str, torch.Tensor]:
    """The statistics for intervals and appearance: of a run's network, on crops of its real validation panoramas."""
    content = read_trained(path)
    network = trained_camera_network(content, path)
    plain = own_config(content[KEY]).plain
    real = {name: source for name, source in plain["dataset"]["sources"].items() if "folder" in source}
    config = validate({**plain, "dataset": {**plain["dataset"], "sources": real, "repeats": {}}})
    chapter: Any = chapter_of("calibration")
    data = chapter.data(config, chapter.source(config))
    data.setup("validate")
    crops = data.split("val")
    numbers = np.arange(CROPS * len(crops.panoramas))
    rows = []
    for some in np.array_split(numbers, -(-len(numbers) // 120)):
        batch = crops[some.tolist()]
        images = batch.images_in_unit_range()
        camera, scale = network(images, batch.aspect)
        error = (reported(camera) - reported(batch.cameras)).abs()
        rows.append((error / scale, network.looks(images, batch.aspect), batch.panoramas))
    scores, looks, panoramas = (torch.cat(column) for column in zip(*rows, strict=True))
    for name in ("scores", "looks_scores"):
        setattr(network, name, torch.zeros(len(scores), *getattr(network, name).shape[1:]))
    CameraNetwork.keep_validation(network, scores, looks, panoramas)
    return {name: getattr(network, name) for name in ("scores", "looks_mean", "looks_whitening", "looks_scores")}


def main() -> None:
    given = parse_arguments(sys.argv[1:], KEYS, USAGE)
    outputs = Path(given.get("outputs", default_outputs()))
    content = read_trained(resolve_run(given["run"], outputs).checkpoint)
    trained, kept = content[KEY], {}
    model = {"schema_version": trained["schema_version"], "task": trained["task"], "spec": trained["spec"]}
    if trained["task"] == "calibration":
        kept = measured(resolve_run(given["intervals"], outputs).checkpoint)
        model["spec"] = {**trained["spec"], "validation_crops": len(kept["scores"]), "per_panorama": 1}
    weights = {name: tensor for name, tensor in content["state_dict"].items() if not name.startswith("loss.")} | kept
    model["config"] = without_places(trained["config"])
    facts = json.loads(Path(given["card"]).read_text(encoding="utf-8"))
    if FITTED in facts:  # for place recognition: confidences, by benchmarks.unseen_places
        model["spec"] = {**model["spec"], FITTED: facts.pop(FITTED)}
    folder = find_map(given["run"], outputs) if trained["task"] == "localization" else None
    written = write_model(given["name"], model, weights, facts)
    if folder is not None:
        shutil.rmtree(kept_map := written.with_suffix(""), ignore_errors=True)
        shutil.copytree(folder, kept_map, ignore=shutil.ignore_patterns(PICTURES))
    print(written)


if __name__ == "__main__":
    main()
