"""The options of each group of configs, and what each needs beside it."""

from typing import get_args

from omegaconf import OmegaConf

from sextant.chapters.places.config import PlaceLoss
from sextant.composing.config_files import groups
from sextant.config.schema.parts import parts_of
from sextant.runs.outputs_folder import conf_dir

CHOICES = [(group, option) for group, options in groups().items() for option in options]
NEEDED = {
    "corruption=files": ["corruption.folder=/nowhere"],
    "dataset=image_folder": ["dataset.folder=/nowhere"],
    "dataset=place_folders": ["dataset.folder=/nowhere"],
    "dataset=panorama_folder": ["dataset.folder=/nowhere", "task=calibration"],
    "dataset=panorama_mix": ["dataset.sources.real.folder=/nowhere", "task=calibration"],
    "experiment=deepcalib_paper": ["dataset.folder=/nowhere"],
    "experiment=localization_folder": ["dataset.folder=/nowhere"],
    "experiment=calibration_photos": ["dataset.sources.real.folder=/nowhere"],
    "experiment=calibration_held": ["dataset.sources.real.folder=/nowhere"],
    "tracking=server": ["tracking.uri=http://127.0.0.1:1"],
    "parameterization": ["task=calibration"],
    "loss": ["task=calibration"],
    "sampling": ["task=calibration"],
    "pooling": ["task=place_recognition"],
    "mining": ["task=place_recognition"],
    "local": ["task=place_recognition"],
    "local=aliked": ["task=place_recognition", "local.weights=/nowhere"],
}
PLACE_TARGETS = {get_args(part.model_fields["target"].annotation)[0] for part in parts_of(PlaceLoss)}
PLACE_LOSSES = {
    option
    for option in groups()["loss"]
    if OmegaConf.load(conf_dir() / "loss" / f"{option}.yaml")["_target_"] in PLACE_TARGETS
}
NEEDED |= {f"loss={name}": ["task=place_recognition"] for name in PLACE_LOSSES}
LOCALIZATION = ("descriptor", "observation", "kernel", "likelihood", "motion", "filter", "recovery", "fault", "faults")
NEEDED |= {group: ["task=localization"] for group in LOCALIZATION}
NEEDED |= {group: ["task=cosfire"] for group in ("features", "bank", "strategy", "filters")}
NEEDED |= {
    "experiment=cosfire_places": ["features.run=gone"],
    "sweep=cosfire_places": ["features.run=gone", "descriptor=run", "descriptor.run=gone"],
    "bank=gabor": ["task=cosfire", "strategy=circles"],
    "bank=dog": ["task=cosfire", "strategy=circles"],
    "bank=channels": ["task=cosfire", "strategy=channel_peaks"],
    "features=run": ["task=cosfire", "features.run=gone"],
    "strategy=circles": ["task=cosfire", "bank=gabor"],
    "strategy=channel_peaks": ["task=cosfire", "bank=channels"],
}
NEEDED |= {
    "dataset=pose_folder": ["dataset.folder=/nowhere"],
    "descriptor=files": ["task=localization", "descriptor.folder=/nowhere"],
    "descriptor=landmarks": ["task=localization", "descriptor.photo=gone.png", "descriptor.points=[[3,4]]"],
    "descriptor=network": ["task=localization", "backbone=place_cnn"],
    "descriptor=run": ["task=localization", "descriptor.run=gone"],
    "fault=wrong_season_map": ["task=localization", "fault.condition=winter_snow"],
}


def words(group: str, option: str) -> list[str]:
    """Overrides that choose an option, and what it needs."""
    choice = f"{group}={option}"
    return [choice, *NEEDED.get(choice, NEEDED.get(group, []))]
