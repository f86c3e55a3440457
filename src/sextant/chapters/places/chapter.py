"""The chapter of place recognition: what its runs consist of."""

from collections.abc import Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from sextant.chapters.places.config import AlikedSettings, PlacesConfig, TrunkSettings
from sextant.chapters.places.off_the_shelf import off_the_shelf, weights_identity
from sextant.config.building import build, part_name
from sextant.config.schema.networks import TimmBackbone, TorchvisionBackbone
from sextant.data.source import MissingDataError
from sextant.errors import ArgumentError, UserError
from sextant.evaluation.headline import Headline
from sextant.kit.assemble import about_headline, build_dataset, build_suite, build_training, is_corrupted
from sextant.kit.chapter import Chapter, Source, TestRecord
from sextant.reporter import Reporter

if TYPE_CHECKING:
    from numpy import ndarray
    from torch import nn

    from sextant.baselines.network_layer import NetworkLayer
    from sextant.chapters.places.data import PlaceImages, PlaceSource
    from sextant.chapters.places.data.datamodule import PlaceData
    from sextant.chapters.places.data.images import Split
    from sextant.chapters.places.task import PlaceRecognition
    from sextant.kit.measure import RunValues, SharedSet
    from sextant.models import PlaceNet


#: the dataset that is only for tests
FACTORS = "town_factors"
#: default size of the images of dataset=place_folders
SIZE = {"height": 64, "width": 96, "channels": 3}
#: height and width of images for training-free and linear descriptors
BASELINE_SIZE = (32, 64)


class PlacesChapter(Chapter[PlacesConfig]):
    """See :class:`~sextant.chapters.places.task.PlaceRecognition`."""

    about = "Descriptors that are invariant to weather and season (chapter 3)."
    evaluation_example = ("dataset=place_folders", "dataset.folder=<folder of reference/ and query/>")
    monitor = ("val/recall_at_1", "max")
    sweep_example = ("loss", ("info_nce", "triplet_ratio"))
    test_settings = ("baselines", "off_the_shelf", "rerank", "sequence_length", "test_tolerance")

    def evaluation_words(self, config: PlacesConfig) -> tuple[str, ...]:
        """Folders of images of the size that the network takes."""
        sizes = {key: config.plain["dataset"].get(key, usual) for key, usual in SIZE.items()}
        other = [f"dataset.{key}={value}" for key, value in sizes.items() if value != SIZE[key]]
        return (*self.evaluation_example, *other)

    def prediction_example(self, config: PlacesConfig) -> tuple[str, ...]:
        """A map and its queries."""
        return ("map=<folder>", "queries=<folder>")

    def identity(self, config: PlacesConfig) -> dict[str, Any]:
        """The base identity, with that of the off-the-shelf weights with which the network is compared."""
        found, shelf = super().identity(config), config.task.off_the_shelf
        if shelf is not None:
            found["task"]["off_the_shelf"]["weights"] = weights_identity(shelf, Path(config.paths.outputs))
        if isinstance(config.local, AlikedSettings):  # its files are checked by their hashes when it is built
            del found["local"]["weights"]
        return found

    def source(self, config: PlacesConfig) -> "PlaceSource":
        """The dataset as a source of places."""
        from sextant.chapters.places.data import (
            ConditionSplit,
            ConditionSplitSource,
            as_place_source,
            rendered_place_source,
        )
        from sextant.chapters.places.data.corrupted import CorruptedQueries

        self.check_parts(config)
        source = as_place_source(build_dataset(config))
        world = rendered_place_source(source)
        if world is not None:
            world.showing = partial(self.reporter.progress, f"rendering {world.name}, once", "images")
        task = config.task
        if task.rerank is not None:
            _check_reranking(config, source)
        if task.off_the_shelf is not None:
            weights_identity(task.off_the_shelf, Path(config.paths.outputs))  # reports a missing file at once
        corrupts = is_corrupted(config)
        if source.name == FACTORS:  # all its conditions belong to the test
            if corrupts:
                raise UserError(
                    "corruption: dataset=town_factors varies one factor at a time and cannot be corrupted",
                    "corruption=none",
                )
            return source
        if task.train_conditions is not None or task.test_conditions is not None:
            train, test = (None if c is None else tuple(c) for c in (task.train_conditions, task.test_conditions))
            source = ConditionSplitSource(source, ConditionSplit(train, test, tuple(task.shared_conditions)))
        return CorruptedQueries(source, build_suite(config)) if corrupts else source

    def check(self, source: Source) -> None:
        """Raise a ``UserError`` if nothing can be trained on the source, or files of a split are missing."""
        _can_train_on(source)
        super().check(source)

    def summary(self, config: PlacesConfig) -> dict[str, str]:
        """Network and training settings."""
        return {name: part_name(config.plain[name]) for name in ("backbone", "pooling", "inhibition", "loss", "mining")}

    def batches(self, config: PlacesConfig) -> str:
        """The size of a batch, in places and conditions."""
        return f" of batches of {config.task.batch_places} places under {config.task.batch_conditions} conditions"

    def data(self, config: PlacesConfig, source: "PlaceSource") -> "PlaceData":
        """Batches of places."""
        from sextant.chapters.places.data.augmentation import PlaceAugmentation
        from sextant.chapters.places.data.datamodule import PlaceData

        task = config.task
        return PlaceData(
            source,
            _tolerance(task.tolerance, source),
            _tolerance(task.test_tolerance, source),
            batch_places=task.batch_places,
            batch_conditions=task.batch_conditions,
            eval_batch_size=config.trainer.eval_batch_size,
            seed=config.seed,
            workers=config.trainer.workers,
            augmentation=PlaceAugmentation(**task.augmentation.model_dump()),
        )

    def spec(self, config: PlacesConfig, source: "PlaceSource", data: "PlaceData") -> dict[str, Any]:
        """The shape of the images; reads all splits, so that mistakes are reported before training."""
        _can_train_on(source)
        data.check()
        task = config.task
        if task.whitening is not None:
            from sextant.chapters.places.whitening import require_enough

            require_enough(data.split("train"), data.tolerance, task.dimension, task.whitening.images)
        _, height, width, channels = data.split("val").images.shape
        return {"channels": channels, "height": height, "width": width} | _statistics(config, channels)

    def module(self, config: PlacesConfig, spec: Mapping[str, Any], *, training: bool) -> "PlaceRecognition":
        """The module of place recognition."""
        from sextant.chapters.places.data.decoded_images import ImageSize
        from sextant.chapters.places.network import place_network
        from sextant.chapters.places.task import PlaceRecognition
        from sextant.chapters.places.whitening import Whitening
        from sextant.models.onnx_place_net import OnnxPlaceNet
        from sextant.models.published_place_net import PublishedPlaceNet

        task = config.plain["task"]
        network = place_network(config.plain, spec, partial(build, config.plain))
        if isinstance(network, PublishedPlaceNet | OnnxPlaceNet):
            if training:
                raise UserError("backbone: published networks for places are not trained here", "backbone=resnet18")
        elif training and task["whitening"] is not None and network.pooling.features < task["dimension"]:
            raise UserError(
                f"task.whitening: the pooling gives {network.pooling.features} numbers, fewer than task.dimension="
                f"{task['dimension']}",
                f"task.whitening=null, or task.dimension={network.pooling.features} or less",
            )
        if config.task.rerank is not None and _needs_network(config):
            _local_features(config, network)  # reports a network without such activations before any work
        return PlaceRecognition(
            cast("PlaceNet", network),  # a published one is only tested
            ImageSize(spec["height"], spec["width"], spec["channels"]),
            build(config.plain, "loss"),
            build(config.plain, "mining"),
            seed=config.seed,
            clip=task["clip"],
            whitening=None if task["whitening"] is None else Whitening(**task["whitening"]),
            **build_training(config, training=training),
        )

    def require_fit(self, config: PlacesConfig, spec: Mapping[str, Any], source: "PlaceSource") -> None:
        """Raise a ``UserError`` unless the test images have the shape of training; other splits are optional.

        Without a validation split there is no posterior, as its temperature is fitted there. Without a training split,
        baselines are fitted to the map's images; see :meth:`record`.
        """
        from sextant.chapters.places.invariance import has_factors

        others: tuple[Split, ...] = ("train",) if has_factors(source.conditions("test")) else ("train", "val")
        for split in others:
            with suppress(MissingDataError):
                source.files(split)
        _, height, width, channels = source.read("test").images.shape
        if (channels, height, width) != (spec["channels"], spec["height"], spec["width"]):
            raise UserError(
                f"dataset={source.name} has images of {channels}x{height}x{width}, "
                f"the model was trained on {spec['channels']}x{spec['height']}x{spec['width']}",
                f"dataset.height={spec['height']} dataset.width={spec['width']} dataset.channels={spec['channels']}",
            )

    def record(self, module: "PlaceRecognition", data: "PlaceData", config: PlacesConfig) -> TestRecord:
        """Compare the network with training-free and linear descriptors: table, hits per query, figures."""
        from torch.nn import MultiheadAttention

        from sextant.chapters.places import report
        from sextant.chapters.places.data.corrupted import CorruptedQueries
        from sextant.chapters.places.invariance import condition_pairs, has_factors, pair_arrays, pair_metrics
        from sextant.chapters.places.methods import describe_all, network_descriptors
        from sextant.chapters.places.methods import fitted as learnt
        from sextant.chapters.places.reranked_recall import rerank_reports
        from sextant.models import network_cost

        assert module.result is not None
        task, result = config.task, module.result
        if has_factors(result.places.conditions):
            return _factors_record(config, module, data, self.reporter)
        network, own = module.network.eval(), result.descriptors
        train, val = _split_beside(data, "train"), _split_beside(data, "val")
        seen = _seen_by_baselines(train, result.places)
        described, shelf_left_out = {report.NETWORK: own}, dict[str, str]()
        if task.baselines:
            shelf, shelf_left_out = learnt(_shelf(config, module), seen, result.places.conditions[0])
            untrained = _untrained(config, module, result.places)
            described = describe_all(shelf, result.places) | untrained | described
        with self.reporter.progress("comparing descriptors", "conditions") as progress:
            found = report.compare(
                described,
                result.places,
                seen if task.baselines else None,
                data.test_tolerance,
                sequence_length=task.sequence_length,
                size=BASELINE_SIZE,
                progress=progress,
            )
        posteriors = None
        if val is not None:
            first = None if train is None else train.select(train.rows_of(train.conditions[0]))
            elsewhere = None if first is None else network_descriptors(network, first)
            fitted = report.temperature(network_descriptors(network, val), val, data.test_tolerance, elsewhere)
            posteriors = report.posteriors_of(found, fitted)
        reranked = None
        if task.rerank is not None:
            with self.reporter.progress("re-ranking", "queries") as progress:
                features = _local_features(config, module.network)
                reranked = rerank_reports(found, result.places, features, task.rerank, progress)
        spec = module.spec
        cost = network_cost(network, (spec.height, spec.width), spec.channels)
        pairs = condition_pairs(own, result.places, data.test_tolerance)
        under = data.source.suite.conditions()[1:] if isinstance(data.source, CorruptedQueries) else []
        headline = Headline(
            "recall@1", "%", "higher", {"clean": 1.0} | report.recall_under(found, result.places.copies, under)
        )
        return TestRecord(
            report.arrays(found) | pair_arrays(pairs, data.test_tolerance) | (reranked.arrays if reranked else {}),
            report.figures(found, result.places, pairs),
            report.metrics(found, posteriors)
            | pair_metrics(pairs, data.test_tolerance)
            | headline.metrics()
            | (reranked.metrics if reranked else {}),
            report.table(found, task.sequence_length, reranked),
            facts={
                "cost": {
                    **(
                        {"multiplications": cost.macs, "pull_multiplications": cost.pull_macs}
                        if cost.layers and not any(isinstance(m, MultiheadAttention) for m in network.modules())
                        else {}  # not counted
                    ),
                    "descriptor_bytes": 4 * own.shape[1],
                },
                "skipped": {split: list(images.skipped) for split, images in data.splits.items()},
                "ceiling": report.ceilings(found),
                **({} if reranked is None else {"reranked": reranked.facts}),
                "baselines_left_out": {each.protocol.query: each.left_out | shelf_left_out for each in found},
                **about_headline(config, headline, (spec.height, spec.width)),
            },
        )

    def measured(
        self, arrays: Mapping[str, "ndarray"], shared: "SharedSet | None" = None, reads: str | None = None
    ) -> "RunValues":
        """Recall."""
        from sextant.chapters.places.measure import places_found

        return places_found(arrays)

    def new_network(self, config: PlacesConfig, spec: Mapping[str, Any]) -> "nn.Module":
        """The network of :func:`~sextant.chapters.places.network.place_network`."""
        from sextant.chapters.places.network import place_network

        return place_network(config.plain, spec, partial(build, config.plain))


CHAPTER = PlacesChapter


def _statistics(config: PlacesConfig, channels: int) -> dict[str, Any]:
    """Mean and deviation of the images on which the weights of a backbone of torchvision or timm were trained."""
    backbone = config.backbone
    if not isinstance(backbone, TimmBackbone | TorchvisionBackbone):
        return {}
    from sextant.chapters.places.backbone_layer import brings_weights, statistics

    if not brings_weights(config.plain["backbone"]):
        return {}
    mean, std = statistics(config.plain["backbone"], channels)
    return {"mean": list(mean), "std": list(std)}


def _split_beside(data: "PlaceData", split: "Split") -> "PlaceImages | None":
    """The images of a split other than the test's; None if it does not exist."""
    with suppress(MissingDataError):
        data.read(split)
    return data.splits.get(split)


def _seen_by_baselines(train: "PlaceImages | None", places: "PlaceImages") -> "PlaceImages":
    """The images that baselines are fitted to: the training images or, without any, those of the map, never queries."""
    return places.only_conditions(places.conditions[:1]) if train is None else train


def _can_train_on(source: Source) -> None:
    if source.name == FACTORS:
        raise UserError(
            "dataset=town_factors is for tests only: it has a single training condition and no validation split",
            "sextant evaluate run=<run> dataset=town_factors",
        )


def _factors_record(
    config: PlacesConfig, module: "PlaceRecognition", data: "PlaceData", reporter: Reporter
) -> TestRecord:
    """Recall of the network, and of descriptors that need no pairs, against one appearance factor at a time."""
    from sextant.chapters.places import invariance as curves
    from sextant.chapters.places import report
    from sextant.chapters.places.methods import describe_all, fitted, training_free

    assert module.result is not None
    task, places = config.task, module.result.places
    described, left_out = {report.NETWORK: module.result.descriptors}, dict[str, str]()
    if task.baselines:
        seen = _seen_by_baselines(_split_beside(data, "train"), places)
        methods, left_out = fitted(training_free(*BASELINE_SIZE) | _shelf(config, module), seen, places.conditions[0])
        untrained = _untrained(config, module, places)
        described = describe_all(methods, places) | untrained | described
    with reporter.progress("comparing descriptors", "conditions") as progress:
        found = report.compare(
            described,
            places,
            None,
            data.test_tolerance,
            sequence_length=task.sequence_length,
            size=BASELINE_SIZE,
            progress=progress,
        )
    invariance = curves.invariance(found)
    return TestRecord(
        report.arrays(found),
        iter([("invariance_curves", curves.invariance_figure(invariance))]),
        curves.invariance_metrics(found),
        curves.invariance_table(invariance),
        facts={
            "invariance": curves.invariance_facts(invariance),
            "skipped": {"test": list(places.skipped)},
            "baselines_left_out": left_out,
        },
    )


def _shelf(config: PlacesConfig, module: "PlaceRecognition") -> "dict[str, NetworkLayer]":
    """The off-the-shelf layer that the config names, by its name in the table; empty without one."""
    shelf = config.task.off_the_shelf
    if shelf is None:
        return {}
    name, layer = off_the_shelf(shelf, (module.spec.height, module.spec.width), Path(config.paths.outputs))
    layer.features.to(module.device)
    return {name: layer}


def _untrained(config: PlacesConfig, module: "PlaceRecognition", places: Any) -> dict[str, Any]:
    """Descriptors of the untrained network, initialised with the run's seed; none for an ONNX file, which has no such.

    They are by their name in the table.
    """
    import torch

    from sextant.chapters.places.methods import network_descriptors
    from sextant.models.onnx_place_net import OnnxPlaceNet

    if isinstance(module.network, OnnxPlaceNet):
        return {}

    spec, standardize = module.spec, module.network.standardize
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(config.seed)
        fresh = PlacesChapter().module(
            config,
            {
                **{"channels": spec.channels, "height": spec.height, "width": spec.width},
                **{key: getattr(standardize, key).flatten().tolist() for key in ("mean", "std")},
            },
            training=False,
        )
    return {"untrained network": network_descriptors(fresh.network.eval().to(module.device), places)}


def _needs_network(config: PlacesConfig) -> bool:
    return isinstance(config.local, TrunkSettings)


def _check_reranking(config: PlacesConfig, source: Source) -> None:
    """Raise a ``UserError`` if matches cannot be re-ranked, except for what the network must tell."""
    rerank = f"task.rerank={config.task.rerank}"
    if source.name == FACTORS:
        raise UserError(f"{rerank}: matches of dataset=town_factors are not re-ranked", "task.rerank=null")
    if config.local is None and config.plain.get("local") is not None:
        raise UserError(f"local=none: {rerank} needs local features", "local=xfeat, or task.rerank=null")
    if not _needs_network(config):
        _local_features(config)


def _local_features(config: PlacesConfig, network: "nn.Module | None" = None) -> Any:
    """The local features of the config, checked; XFeat at its own settings without any."""
    from sextant.chapters.places.photo_features import checked, extractor_of, trunk_features

    if config.local is None:
        return extractor_of("xfeat", None)
    chosen = config.local
    try:
        if not isinstance(chosen, TrunkSettings):
            return checked(build(config.plain, "local"))
        settings = {"keypoints": chosen.keypoints, "side": chosen.side, "layers": chosen.layers}
        found = trunk_features(network, **settings)
        return checked(replace(found, network=deepcopy(found.network).cpu().eval()))
    except ArgumentError as error:
        raise error.within("local", config.plain["local"]) from None


def _tolerance(chosen: Any, source: "PlaceSource") -> Any:
    """The tolerance in the unit of the source's places."""
    from sextant.chapters.places.data import PlaceTolerance

    return PlaceTolerance(source.place_unit, **getattr(chosen, source.place_unit).model_dump())
