"""The chapter of localization: what its runs consist of."""

import json
import math
import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sextant.chapters.localization.config import LASERS, ExponentialMotion, LocalizationConfig, SpacingMotion
from sextant.chapters.localization.metric_parts import check_camera, check_metric, metric_map
from sextant.chapters.places.config import AlikedSettings
from sextant.chapters.places.descriptors import about_weights, check_network_parts, describer, descriptor_identity
from sextant.config.building import build, part_name
from sextant.errors import UserError
from sextant.evaluation.headline import Headline
from sextant.kit.assemble import (
    about_headline,
    build_dataset,
    build_suite,
    build_training,
    conditions_name,
    fit_dataset,
    is_corrupted,
)
from sextant.kit.chapter import Chapter, TestRecord

if TYPE_CHECKING:
    from numpy import ndarray

    from sextant.chapters.localization.data.datamodule import LocalizationDataModule
    from sextant.chapters.localization.data.source import LocalizationSource
    from sextant.chapters.localization.testing import TestSettings
    from sextant.kit.measure import RunValues, SharedSet
    from sextant.localization.motion import MotionModel

#: default standard deviation of the heading of poses drawn around a map image, in rad
SPREAD_HEADING = math.radians(10)

#: ways of fitting a likelihood: to single images of the validation drives, or additionally to a filter along them
ALONG_DRIVES = "along_drives"
FITTED = ("fitted", ALONG_DRIVES)


class LocalizationChapter(Chapter[LocalizationConfig]):
    """See :class:`~sextant.chapters.localization.task.Localization`."""

    about = "Gaussian processes in a particle filter (chapters 4 and 5)."
    evaluation_example = ("fault=dropped_frames",)  # of any drive, also a short one
    fits_elsewhere = True
    splits = ("map", "validation", "test")
    monitor = ("val/place_nll", "min")
    alone = "learns a few hyper-parameters of a Gaussian process, which needs only one process"
    on_cpu = "learns a few hyper-parameters and weights a few thousand particles, which takes one core milliseconds"
    sweep_example = ("recovery", ("none", "bayes_restart"))
    test_settings = ("starts", "horizon", "every", "particle_counts", "replay", "save_map", "odometry_scale")

    def prediction_example(self, config: LocalizationConfig) -> tuple[str, ...]:
        """Photos along a route, localized in the map of images that the run saved, if it saved one."""
        return ("input=<folder of photos>", "odometry=<table>") if _keeps_map(config) else ()

    def check_parts(self, config: LocalizationConfig) -> None:
        """Raise a ``UserError`` if the choices of several groups are incompatible."""
        super().check_parts(config)
        check_network_parts(config)
        if config.filter.best is not None and isinstance(config.observation, LASERS):
            raise UserError(
                f"filter.best={config.filter.best}: scans are compared with walls, not with images of the map",
                "Leave out filter.best (filter=particles), or localize a camera: observation=cached_local",
            )
        if config.filter.adapts and isinstance(config.observation, LASERS):
            raise UserError(
                "filter.adapts=true: a laser's scans do not change with the appearance of the world",
                "Leave out filter.adapts, or localize a camera: observation=cached_local",
            )

        check_metric(config)

    def identity(self, config: LocalizationConfig) -> dict[str, Any]:
        """The base identity, with that of the descriptor."""
        found, outputs = super().identity(config), Path(config.paths.outputs)
        if isinstance(config.local, AlikedSettings):  # its files are checked by their hashes when it is built
            del found["local"]["weights"]
        if isinstance(config.observation, LASERS):
            for key in ("support", "regions"):  # these apply only to maps of images
                found["filter"].pop(key, None)
            if found["likelihood"]["tempering"] == ALONG_DRIVES:  # with a laser, tempering is fitted to single scans
                found["likelihood"]["tempering"] = "fitted"
        return found | {"descriptor": descriptor_identity(found["descriptor"], outputs)}

    def source(self, config: LocalizationConfig) -> "LocalizationSource":
        """The dataset as a source of drives."""
        from sextant.chapters.localization.data.fitted_elsewhere import FittedElsewhere
        from sextant.chapters.localization.data.simulated import DriveSettings
        from sextant.chapters.localization.data.source import as_localization_source

        self.check_parts(config)
        if isinstance(config.observation, LASERS) and isinstance(config.filter.support, int | float):
            raise UserError(
                f"filter.support={config.filter.support:g} is a distance from the images of a map, but a laser's map "
                "consists of walls",
                "Leave filter.support out, or filter.support=map",
            )
        if is_corrupted(config) and (isinstance(config.observation, LASERS) or "folder" in config.plain["descriptor"]):
            blind = "a laser observation" if isinstance(config.observation, LASERS) else "descriptor=files"
            raise UserError(f"corruption changes images, but {blind} uses none", "corruption=none")
        task = config.task
        outputs = Path(config.paths.outputs)
        descriptor_identity(config.plain["descriptor"], outputs)  # reports a missing run at once
        settings = DriveSettings(task.odometry_scale, task.odometry_seed, task.validation_share, task.near_map)
        elsewhere = fit_dataset(config)
        built = [build_dataset(config), *([] if elsewhere is None else [elsewhere])]
        tested, *fitted = (as_localization_source(dataset, settings) for dataset in built)
        for source in (tested, *fitted):
            if hasattr(source, "showing"):
                source.showing = partial(self.reporter.progress, f"rendering {source.name}, once", "images")
        whole = FittedElsewhere(tested, fitted[0], config.plain["dataset"]["fit_world"]) if fitted else tested
        if not is_corrupted(config):
            return whole
        from sextant.chapters.localization.data.corrupted_drives import CorruptedDrives

        return CorruptedDrives(whole, build_suite(config), json.dumps(config.plain["corruption"], sort_keys=True))

    def summary(self, config: LocalizationConfig) -> dict[str, str]:
        """Descriptor, model and filter."""
        names = ("descriptor", "observation", "motion", "recovery")
        faults = config.plain["fault"] if config.faults is None else None
        told = {name: part_name(config.plain[name]) for name in names}
        particles = config.task.particle_counts or [config.filter.particles]
        told["filter"] = f"{', '.join(map(str, particles))} particles, start={config.filter.start}"
        if config.filter.adapts:
            told["filter"] += ", adapts"
        if config.filter.metric is not None:
            told["filter"] += f", located poses: {config.filter.metric}"
        if config.filter.best is not None:
            told["filter"] = f"none: poses averaged over the {config.filter.best} most similar images"
        told["test"] = conditions_name(config.plain["corruption"])
        told["faults"] = ", ".join(config.plain["faults"]["faults"]) if faults is None else part_name(faults)
        return told

    def batches(self, config: LocalizationConfig) -> str:
        """All of the map."""
        return ""

    def data(self, config: LocalizationConfig, source: "LocalizationSource") -> "LocalizationDataModule":
        """The drives with their descriptors."""
        from sextant.chapters.localization.data.datamodule import LocalizationDataModule

        task = config.task
        return LocalizationDataModule(
            source,
            describer(config),
            Path(config.paths.cache),
            images=task.images,
            fixed=task.objective != "vecchia",
            seed=config.seed,
            merge_duplicates=task.merge_duplicates,
            show=lambda what: self.reporter.progress(what, "images"),
        )

    def spec(self, config: LocalizationConfig, source: Any, data: "LocalizationDataModule") -> dict[str, Any]:
        """The descriptor's dimension and the unit; reads all drives, so that mistakes are reported before training."""
        from sextant.chapters.localization.testing import check_runs
        from sextant.chapters.localization.validation import check_validation

        drives = data.drives
        if config.filter.metric is not None:
            check_camera(drives, config)
            metric_map(config, data)  # a mistake in the features is said before training
        check_validation(drives)
        check_runs(drives, _faults(config), test_settings(config, data))
        if "folder" in config.plain["descriptor"]:  # read vector files now, before a mistake in them costs time
            for drive in (drives.map, drives.validation_map, *drives.validation, *drives.test):
                if drive is not None:
                    data.descriptors(drive)
        return {"dimension": 0 if isinstance(config.observation, LASERS) else data.dimension, "unit": drives.unit}

    def module(self, config: LocalizationConfig, spec: Mapping[str, Any], *, training: bool) -> Any:
        """The module of localization, from images or a laser."""
        task, likelihood = config.plain["task"], config.plain["likelihood"]
        if isinstance(config.observation, LASERS):
            from sextant.chapters.localization.laser import LaserLocalization

            given = likelihood["tempering"]
            return LaserLocalization(
                partial(_scan_model, config),
                None if given in FITTED else float(given),
                task["validation_images"],
                task["resolution_m"],
            )
        from sextant.chapters.localization.task import Calibration, Localization
        from sextant.localization.likelihood import Likelihood

        fit_tempering, fit_noise = (likelihood[key] in FITTED for key in ("tempering", "appearance_noise"))
        calibration = Calibration(
            Likelihood(
                likelihood["form"],
                1.0 if fit_tempering else float(likelihood["tempering"]),
                0.0 if fit_noise else float(likelihood["appearance_noise"]),
                likelihood["dof"],
            ),
            fit_tempering,
            fit_noise,
            likelihood["whitening"],
            task["validation_images"],
            partial(test_settings, config) if likelihood["tempering"] == ALONG_DRIVES else None,
            partial(test_settings, config) if config.plain["filter"].get("regions") == ALONG_DRIVES else None,
            self.reporter.progress,
        )
        kernel = config.plain["kernel"]
        sharper = kernel.get("sharper")
        return Localization(
            spec["dimension"],
            kernel["spatial"],
            kernel["ard"],
            partial(build, config.plain, "observation"),
            calibration,
            sharper=sharper and (sharper["length"], sharper["noise"], sharper.get("heading", 1.0)),
            objective=task["objective"],
            neighbours=task["neighbours"],
            metric=None if config.filter.metric is None else partial(metric_map, config),
            weighs=config.filter.metric in ("likelihood", "both"),
            **build_training(config, training=training),
        )

    def require_fit(self, config: LocalizationConfig, spec: Mapping[str, Any], source: "LocalizationSource") -> None:
        """Raise a ``UserError`` unless positions have the unit of training, as hyper-parameters are lengths."""
        unit = source.read().unit
        if unit != spec["unit"]:
            raise UserError(
                f"dataset={source.name} has positions in {unit}, but the kernel was trained on {spec['unit']}",
                "Train on this dataset.",
            )

    def record(self, module: Any, data: "LocalizationDataModule", config: LocalizationConfig) -> TestRecord:
        """Localize along the test drives, with each fault and each number of particles."""
        from sextant.chapters.localization import report, under_corruption
        from sextant.chapters.localization.along_drives import widened
        from sextant.chapters.localization.judged import judge
        from sextant.chapters.localization.testing import run_trials, short_drives
        from sextant.chapters.localization.validation import protocol_of

        faults, settings = _faults(config), test_settings(config, data)
        kernel = None if isinstance(config.observation, LASERS) else module.kernel.frozen()
        with self.reporter.progress("localizing", "trials") as progress:
            trials_of = run_trials(data.drives, faults, settings, partial(module.observers, data), progress, kernel)
            outcomes = list(widened(trials_of, region_scale(module, config)))
        trials = [outcome.trial for outcome in outcomes]
        everything = {report.name_of(o.trial, trials): judge(o, data.drives) for o in outcomes}
        found = {name: judged for name, judged in everything.items() if not judged.outcome.trial.corruption}
        told = report.metrics(found, data.drives)  # before separate measurements add to the peak memory
        told |= under_corruption.metrics(everything)
        headline = Headline("success", "%", "higher", under_corruption.success_by_condition(everything))
        told |= {f"test/{name}": value for name, value in module.sensor_measures(data).items() if value == value}
        files: dict[str, Callable[[Path], None]] = {"trajectories": partial(report.write_trajectories, found)}
        if settings.replay:
            files["figures"] = partial(report.write_replays, found, data.drives)
        if _keeps_map(config):
            from sextant.chapters.localization.run_map import run_localizer, write_map

            files["map"] = lambda folder: write_map(
                run_localizer(module, data, settings, config, region_scale(module, config)), folder
            )
        return TestRecord(
            report.arrays(everything),
            report.figures(found, data.drives),
            told | headline.metrics(),
            report.table(found, data.drives),
            facts={
                **report.facts(found, protocol_of(data.drives)),
                **about_headline(config, headline, _image_size(data)),
                **({"by_corruption": rows} if (rows := under_corruption.table(everything)) else {}),
                "notes": [
                    *data.drives.notes,
                    *short_drives(data.drives.test, settings),
                    *_about_regions(module, config),
                    *about_weights(config),
                ],
            },
            files=files,
        )

    def measured(
        self, arrays: Mapping[str, "ndarray"], shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """Success."""
        from sextant.chapters.localization.measure import localized

        return localized(arrays)


CHAPTER = LocalizationChapter


def _image_size(data: "LocalizationDataModule") -> tuple[int, int]:
    """Height and width of the test images; zeros without images."""
    images = data.drives.test[0].images
    return (0, 0) if images is None else (images.shape[1], images.shape[2])


def region_scale(module: Any, config: LocalizationConfig) -> float:
    """The factor by which reported standard deviations of poses are widened; 1 if this is not requested."""
    one_size = config.filter.regions is None or isinstance(config.observation, LASERS)
    return 1.0 if one_size else float(module.region_scale)


def _about_regions(module: Any, config: LocalizationConfig) -> list[str]:
    """Notes for the reader about confidence regions that were not widened, or widened by the maximum."""
    from sextant.chapters.localization.along_drives import WIDEST

    if config.filter.regions is None or isinstance(config.observation, LASERS):
        return []
    scale = float(module.region_scale)
    if scale == 1.0:
        return [
            "filter.regions=along_drives: regions are not widened: the validation drives required no widening or had "
            "too few usable steps, or the run is older than this key"
        ]
    if scale == WIDEST:
        return [
            f"filter.regions=along_drives: regions are widened by the largest factor, {WIDEST:g}: along the validation "
            "drives the filter was often confidently wrong"
        ]
    return []


def test_settings(config: LocalizationConfig, data: "LocalizationDataModule") -> "TestSettings":
    """The settings of the localization of drives, from a config and a map."""
    from sextant.chapters.localization.testing import TestSettings
    from sextant.localization import resampling
    from sextant.localization.kld_size import KLDSize

    task, filter = config.task, config.filter
    kld = None
    if filter.kld is not None:
        kld = KLDSize(
            filter.kld.epsilon,
            1 - filter.kld.confidence,
            filter.kld.least,
            filter.kld.most,
            filter.kld.bin_position,
            math.radians(filter.kld.bin_heading_deg),
        )
    return TestSettings(
        _motion(config, data),
        build(config.plain, "recovery"),
        getattr(resampling, f"{filter.resampling.capitalize()}Resampling")(),
        filter.ess_threshold,
        kld,
        filter.start,
        tuple(task.particle_counts or [filter.particles]),
        task.starts,
        task.horizon,
        task.every,
        _spread(config, data),
        config.seed,
        task.replay,
        support=None if isinstance(config.observation, LASERS) else filter.support,
        outliers=filter.outliers,
        apart=filter.apart,
        best=filter.best,
        adapts=filter.adapts,
        odds=filter.odds,
        proposes=filter.metric in ("proposal", "both"),
    )


def _motion(config: LocalizationConfig, data: "LocalizationDataModule") -> "MotionModel":
    """The motion model, given the spacing of the map if it depends on it."""
    import torch

    from sextant.localization.map_support import map_spacing

    if not isinstance(config.motion, SpacingMotion):
        found: MotionModel = build(config.plain, "motion")
        return found
    spacing = map_spacing(torch.from_numpy(data.drives.map.poses))
    return build(config.plain, "motion", spacing=spacing, line=data.drives.unit == "frames")  # type: ignore[no-any-return]


def _spread(config: LocalizationConfig, data: "LocalizationDataModule") -> tuple[float, float, float]:
    """Standard deviations of poses drawn around a map image: as configured, or from the spacing of the map's images.

    Where the motion model has no lateral and no heading noise, no step could correct errors in these directions. All
    poses then start on the line with its heading.
    """
    import torch

    from sextant.localization.map_prior import half_spacing

    position = config.filter.spread_position or half_spacing(torch.from_numpy(data.drives.map.poses))
    heading = config.filter.spread_heading_deg
    if data.drives.unit == "frames" or (isinstance(config.motion, ExponentialMotion) and _keeps_line(config.motion)):
        return position, 0.0, 0.0
    return position, position, SPREAD_HEADING if heading is None else math.radians(heading)


def _keeps_line(motion: ExponentialMotion) -> bool:
    told = (motion.per_step, motion.per_metre, motion.per_radian, motion.unknown or [])
    return not any(noise for each in told for noise in each[1:])


def _faults(config: LocalizationConfig) -> dict[str, Any]:
    """The faults to try, by name."""
    if config.faults is None:
        name = re.sub(r"(?<!^)(?=[A-Z])", "_", str(config.plain["fault"]["_target_"]).rsplit(".", 1)[-1]).lower()
        return {"none" if name == "no_fault" else name: build(config.plain, "fault")}
    faults = config.plain["faults"]["faults"]
    return {name: build(faults, name) for name in faults}


def _keeps_map(config: LocalizationConfig) -> bool:
    return bool(config.task.save_map and not isinstance(config.observation, LASERS) and config.filter.best is None)


def _scan_model(config: LocalizationConfig, grid: Any, scanner: Any, tempering: float) -> Any:
    return build(config.plain, "observation", grid=grid, scanner=scanner, tempering=tempering)
