"""The chapter of single-image calibration: what its runs consist of."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from sextant.chapters.calibration.config import CalibrationConfig
from sextant.config.building import build, part_name
from sextant.evaluation.headline import Headline
from sextant.kit.assemble import about_headline, build_dataset, build_suite, build_training, conditions_name
from sextant.kit.chapter import Chapter, TestRecord

if TYPE_CHECKING:
    from numpy import ndarray

    from sextant.chapters.calibration.data.datamodule import CalibrationData
    from sextant.chapters.calibration.data.panoramas import PanoramaSource
    from sextant.chapters.calibration.task import Calibration
    from sextant.kit.measure import RunValues, SharedSet

#: geometric methods, by their names in results
BY_LINES = ("vanishing points", "plumb lines", "both")
#: number of cameras drawn to find the ranges and the median of a distribution, and their seed
DRAWS, DRAW_SEED = 100_000, 999_983


class CalibrationChapter(Chapter[CalibrationConfig]):
    """See :class:`~sextant.chapters.calibration.task.Calibration`."""

    about = "Tilt, roll, focal length and distortion from one image (chapter 2)."
    evaluation_example = ("dataset=panorama_folder", "dataset.folder=<panoramas>")
    monitor = ("val/bearing_deg", "min")
    sweep_example = ("loss", ("bearing_disentangled", "bearing"))
    test_settings = ("geometric_baselines", "geometric_height")

    def source(self, config: CalibrationConfig) -> "PanoramaSource":
        """The dataset as a source of panoramas; invalid camera distributions are refused too."""
        from sextant.chapters.calibration.data.panoramas import as_panorama_source, rendered_sources

        self.check_parts(config)
        for group in ("sampling", "test_sampling"):
            if getattr(config, group) is not None:
                build(config.plain, group)
        source = as_panorama_source(build_dataset(config))
        for world in rendered_sources(source):
            world.showing = partial(self.reporter.progress, f"rendering {world.name}, once", "images")
        return source

    def training_size(self, config: CalibrationConfig, source: "PanoramaSource") -> int | None:
        """The number of crops of the training panoramas."""
        from sextant.chapters.calibration.data.panoramas import panorama_count

        count = panorama_count(source, "train")
        return None if count is None else count * config.task.crops_per_panorama.train

    def summary(self, config: CalibrationConfig) -> dict[str, str]:
        """Network, parameterization, and training settings."""
        plain, names = config.plain, ("backbone", "inhibition", "parameterization", "loss")
        rows = {name: part_name(plain[name]) for name in names}
        return rows | {"sampling": str(plain["sampling"].get("name", "")), "test": conditions_name(plain["corruption"])}

    def answers(self, config: CalibrationConfig) -> list[str]:
        """The network, the image-independent baselines, and the geometric methods if they are tested."""
        blind = ["network", "constant", "prior"]
        return [*blind, *BY_LINES, "network + lines"] if config.task.geometric_baselines else blind

    def data(self, config: CalibrationConfig, source: "PanoramaSource") -> "CalibrationData":
        """Crops of the panoramas."""
        from sextant.chapters.calibration.data.datamodule import CalibrationData

        task = config.task
        return CalibrationData(
            source,
            build(config.plain, "sampling"),
            build(config.plain, "test_sampling") if config.test_sampling is not None else None,
            size=(task.height, task.width),
            crops_per_panorama=task.crops_per_panorama.model_dump(),
            batch_size=config.trainer.batch_size,
            eval_batch_size=config.trainer.eval_batch_size,
            seed=config.seed,
            workers=config.trainer.workers,
            augment=task.augment,
            canvas=task.canvas is not None,
            detail=None if task.canvas is None else (task.canvas.detail[0], task.canvas.detail[1]),
            geometric_height=task.geometric_height,
        )

    def spec(self, config: CalibrationConfig, source: "PanoramaSource", data: "CalibrationData") -> dict[str, Any]:
        """The input size, and ranges that cover the distribution of cameras."""
        import numpy as np

        from sextant.chapters.calibration.network import reported
        from sextant.geometry import CameraParameters, ParameterSpace
        from sextant.geometry.canvas import on_canvas

        task = config.task
        numbers = np.arange(DRAWS)
        drawn = data.distribution.draw_for(numbers, np.zeros_like(numbers), DRAW_SEED)
        cameras = drawn.cameras
        ranged = cameras if task.canvas is None else on_canvas(cameras, drawn.aspect)
        space = ParameterSpace.covering(build(config.plain, "parameterization"), ranged)
        low, high = np.quantile(reported(cameras).numpy(), [0.16, 0.84], axis=0)
        data.setup("validate")
        return {
            "height": task.height,
            "width": task.width,
            "aspects": list(data.distribution.aspects),
            "low": space.low.tolist(),
            "high": space.high.tolist(),
            "validation_crops": data.count("val"),
            "per_panorama": task.crops_per_panorama.val,
            "median": [float(np.median(value)) for value in CameraParameters(*cameras)],
            "spread": ((high - low) / 2).tolist(),
        } | ({} if task.canvas is None else {"canvas": True})

    def module(self, config: CalibrationConfig, spec: Mapping[str, Any], *, training: bool) -> "Calibration":
        """The calibration module."""
        from sextant.chapters.calibration.network import network_parts
        from sextant.chapters.calibration.task import Calibration

        network, facts, parameterization = network_parts(config.plain, spec, partial(build, config.plain))
        return Calibration(
            network,
            facts,
            parameterization,
            build(config.plain, "loss", space=facts.space(parameterization)),
            build_suite(config),
            clip=config.plain["task"]["clip"],
            field_weight=(config.plain["task"].get("perspective_field") or {}).get("weight", 0.0),
            **build_training(config, training=training),
        )

    def require_fit(self, config: CalibrationConfig, spec: Mapping[str, Any], source: Any) -> None:
        """Do nothing: any panoramas can be used."""

    def record(self, module: "Calibration", data: "CalibrationData", config: CalibrationConfig) -> TestRecord:
        """Compare the network with constant and geometric methods: table, errors per crop, figures."""
        from sextant.chapters.calibration.report import arrays, compare, figures, metrics, table

        assert module.result is not None
        with self.reporter.progress("detecting lines", "crops") as progress:
            report = compare(module, data, geometric=config.task.geometric_baselines, progress=progress)
        bearing = {key: float(errors.median()) for key, errors in module.bearing_errors_deg().items()}
        headline = Headline("bearing error (deg)", "", "lower", bearing)
        return TestRecord(
            arrays(module, report),
            figures(module, data, report),
            metrics(module, report) | headline.metrics(),
            table(report, module.result.panoramas),
            facts=about_headline(config, headline, (config.task.height, config.task.width)),
        )

    def measured(
        self, arrays: Mapping[str, "ndarray"], shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """Median errors of the network, or failures of the method ``reads``."""
        from sextant.chapters.calibration.measure import calibrated

        return calibrated(arrays, reads)


CHAPTER = CalibrationChapter
