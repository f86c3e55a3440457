"""What a config says about located poses: what they fit together with, and the map that locates them."""

from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.chapters.localization.config import LASERS, LocalizationConfig
from sextant.chapters.places.config import TrunkSettings
from sextant.config.building import build
from sextant.errors import ArgumentError, UserError

if TYPE_CHECKING:
    from sextant.chapters.localization.data.datamodule import LocalizationDataModule
    from sextant.chapters.localization.data.drive import LocalizationData
    from sextant.chapters.localization.metric_map import MetricMap


def check_metric(config: LocalizationConfig) -> None:
    """Raise a ``UserError`` if other parts do not fit ``filter.metric``. Imports nothing heavy."""
    metric, recovery = config.filter.metric, config.plain["recovery"]
    if metric is None:
        if config.local is not None:
            raise UserError("local: local features locate images only with filter.metric", "filter.metric=both")
        return
    told = f"filter.metric={metric}"
    if isinstance(config.observation, LASERS):
        raise UserError(f"{told}: a laser's scans have no local features", "observation=cached_local")
    if "folder" in config.plain["descriptor"]:
        raise UserError(f"{told}: descriptor=files has no images", "For example descriptor=whitened_pca")
    kind = str(recovery["_target_"]).rsplit(".", 1)[-1]
    if kind not in ("NoRecovery", "BayesRestart"):
        raise UserError(
            f"{told}: located poses are weighted by Bayes' rule, which recovery={kind} does not follow",
            "recovery=bayes_restart or none",
        )
    if recovery.get("weigh_jitter") is False:
        raise UserError(f"{told}: restarts must be weighted at their own poses", "recovery.weigh_jitter=true")
    if metric != "likelihood":
        if recovery.get("window"):
            raise UserError(
                f"{told}: recovery.window={recovery['window']} weighs restarts by several images, without what located "
                "poses found",
                "recovery=bayes_restart, or filter.metric=likelihood",
            )
        motion = config.plain["motion"]["_target_"].rsplit(".", 1)[-1]
        if config.filter.adapts or motion not in ("ExponentialMotion", "motion_of_spacing"):
            named = "filter.adapts=true" if config.filter.adapts else f"motion={motion}"
            raise UserError(
                f"{told}: poses are drawn from a motion whose density is known, which {named} has not",
                "motion=exponential and filter.adapts=false, or filter.metric=likelihood",
            )
    if config.task.save_map:
        raise UserError(f"{told}: a saved map keeps no local features", "task.save_map=false")


def check_camera(drives: "LocalizationData", config: LocalizationConfig) -> None:
    """Raise a ``UserError`` if the camera of a dataset is unknown."""
    if drives.camera is None or drives.unit != "m":
        raise UserError(
            f"filter.metric={config.filter.metric}: the camera of this dataset is not known",
            "dataset=office_walk, for example with dataset.width=320 dataset.height=240; or filter.metric=null",
        )


def metric_map(config: LocalizationConfig, data: "LocalizationDataModule") -> "MetricMap":
    """Locates frames by the local features of the config; XFeat at its own settings without any.

    Raises:
        UserError: the features cannot be extracted.
    """
    from sextant.chapters.localization.metric_map import MetricMap
    from sextant.chapters.places.photo_features import checked, extractor_of, trunk_features

    camera = data.drives.camera
    assert camera is not None
    try:
        if config.local is None:
            features = extractor_of("xfeat", None)
        elif isinstance(config.local, TrunkSettings):
            chosen, describer = config.local, data.describer
            network = getattr(getattr(describer, "network", None), "network", getattr(describer, "layer", None))
            settings: dict[str, Any] = {"keypoints": chosen.keypoints, "side": chosen.side, "layers": chosen.layers}
            found = trunk_features(network, **settings)
            identity = found.identity or str(getattr(describer, "identity", ""))
            features = checked(replace(found, network=deepcopy(found.network).eval(), identity=identity))
        else:
            features = checked(build(config.plain, "local"))
    except ArgumentError as error:
        raise error.within("local", config.plain.get("local") or {}) from None
    return MetricMap(features, camera, Path(config.paths.cache), data.show)
