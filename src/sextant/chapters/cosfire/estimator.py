"""Classification by COSFIRE filters configured from single examples, and by the methods they are compared with."""

import copy
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Any, cast

import torch
from jaxtyping import Float, Float32, Int64, UInt8
from numpy import ndarray
from torch import Tensor, nn

from sextant.baselines.linear_svm import LinearSVM
from sextant.baselines.place_descriptors import LUMA
from sextant.chapters.cosfire.comparison import Comparison
from sextant.chapters.cosfire.filter_prototypes import Prototypes, PrototypeSettings, configure, own_responses
from sextant.chapters.cosfire.fine_tuning import LinearLayer, fine_tune, log_maxima, tune_layer
from sextant.chapters.cosfire.learnt_later import LearntLater, LearntLayer, LearntSVM
from sextant.chapters.cosfire.methods import (
    NEAREST_AMONG,
    OF_EXAMPLES,
    OF_MAXIMA,
    OF_NETWORK,
    REPRESENTATIONS,
    SVMS,
    TUNED,
    Method,
    Representation,
    nearest_example,
    principal_components,
    strongest_filter,
    svm_of,
)
from sextant.chapters.cosfire.representations import feature_maps, filter_maxima
from sextant.chapters.cosfire.seen_images import SeenImages
from sextant.layers.cosfire import Cosfire, DoGBank, GaborBank
from sextant.models import FeatureMap
from sextant.reporter import Advance

Labelled = tuple[UInt8[Tensor, "n c h w"], Int64[Tensor, "n"]]
LabelledSeen = tuple[SeenImages, Int64[Tensor, "n"]]


class CosfireEstimator(nn.Module):
    """Filters, SVMs and everything else that :meth:`fit` fits to examples; ``state_dict`` holds all of it.

    >>> estimator = CosfireEstimator(
    ...     lambda features: Cosfire(GaborBank((6.0,), 8), ConcentricCircles((0.0, 4.0)), t1=0.1),
    ...     ("cross", "circle"),
    ...     PrototypeSettings(per_class=3),
    ...     Comparison(methods=("cosfire_svm",), c_values=(1.0,), scalings=("all",)),
    ...     image_shape=(1, 32, 32),
    ... )  # doctest: +SKIP
    >>> estimator.fit(images, labels)  # doctest: +SKIP
    >>> estimator.scores(others)["cosfire_svm"].argmax(1)  # doctest: +SKIP

    Args:
        filters: makes the filters, with or without a network's feature map.
        classes: names.
        prototypes, comparison: how prototypes are chosen, and what is compared.
        image_shape: channels, height and width.
        network: maps images to logits; None if filters operate on images, or on ``features``.
        layer: the network's layer whose map the filters operate on.
        features: a pretrained, frozen feature map, in place of ``network``.
        describe: computes place descriptors of images, for the method ``descriptor``.
        seed: of the choice of prototypes.
        show: shows the progress of long operations, by name.

    Attributes:
        filters: configured by :meth:`fit`.
        tuned: their fine-tuned copy; None without fine-tuning.
    """

    def __init__(
        self,
        filters: Callable[[FeatureMap | None], Cosfire],
        classes: tuple[str, ...],
        prototypes: PrototypeSettings,
        comparison: Comparison,
        *,
        image_shape: tuple[int, int, int],
        network: nn.Module | None = None,
        layer: str | None = None,
        features: FeatureMap | None = None,
        describe: Callable[[UInt8[ndarray, "n h w c"]], Float32[ndarray, "n d"]] | None = None,
        seed: int = 0,
        show: Callable[[str], AbstractContextManager[Advance]] = lambda what: nullcontext(lambda done, total: None),
    ):
        super().__init__()
        # checkpoints name their arrays after these modules
        self.network = network
        if network is not None:
            features = FeatureMap(copy.deepcopy(network), image_shape[0], image_shape[1:], layer=layer)
        self.features = features
        if features is not None:
            features.requires_grad_(False)
        self._make_filters = partial(filters, features)
        self.filters = self._make_filters()
        self.tuned = self._make_filters() if comparison.fine_tuning.epochs else None
        self.classes, self.prototype_settings, self.comparison = classes, prototypes, comparison
        self.describe, self.seed, self.show = describe, seed, show
        self.prototypes = LearntLater("labels", "images", "points", "own", "pictures", "least_maxima", "least_tiled")
        self.known = LearntLater("images", "labels")
        tuned = TUNED if self.tuned is not None else ()
        self.tuned_layers = nn.ModuleDict({name: LearntLayer() for name in tuned})
        self.machines = nn.ModuleDict({name: LearntSVM() for name in SVMS if name in self.methods})

    @property
    def methods(self) -> list[Method]:
        """The methods of the comparison whose parts exist; the first is used for prediction."""
        missing: set[Method] = set() if self.features is not None else set(OF_NETWORK)
        missing |= {"network"} if self.network is None or not self.comparison.network_answers else set()
        missing |= {"descriptor", "nearest_short"} if self.describe is None else set()
        found = [method for method in self.comparison.methods if method not in missing]
        return [*found, *TUNED] if self.comparison.fine_tuning.epochs else found

    # -- fitting -------------------------------------------------------------------------------------------------------

    def fit(self, images: UInt8[Tensor, "n c h w"], labels: Int64[Tensor, "n"], tuning: Labelled | None = None) -> None:
        """Configure filters from examples, and fit SVMs to them; the network is left unchanged.

        Args:
            images, labels: examples, on the CPU.
            tuning: further images and their labels, by which C and the scaling of features are chosen if the comparison
                has several.

        Raises:
            NoFilterError: no filter can be configured for a class.
            ValueError: there is something to choose and no image to choose by.
            LossNotFiniteError: fine-tuning diverges.
        """
        examples = self._look_at(images)
        self._copy_network()
        self._configure(examples, labels)
        if any(method in self.methods for method in OF_EXAMPLES):
            order = torch.randperm(len(labels), generator=torch.Generator().manual_seed(self.seed))
            rows = order[:NEAREST_AMONG].sort().values
            self.known.keep(images=images[rows], labels=labels[rows])
        held: LabelledSeen | None = None
        if tuning is not None and len(tuning[1]) and len(self.comparison.c_values) * len(self.comparison.scalings) > 1:
            held = self._look_at(tuning[0]), tuning[1]
        for name, kept in self._svms().items():
            logarithmic = self.comparison.logarithms and name in OF_MAXIMA
            kept.keep_svm(self._svm(partial(self._features_of, name), (examples, labels), held, logarithmic))
        if self.tuned is not None:
            self._fine_tune(self.tuned, examples, labels, held)

    def _copy_network(self) -> None:
        """Copy the network in its present state for the filters."""
        if self.network is not None and self.features is not None:
            kept = self.features.state_dict()
            state = {f"network.{name}": value for name, value in self.network.state_dict().items()}
            self.features.load_state_dict({name: value for name, value in state.items() if name in kept})

    def _configure(self, examples: SeenImages, labels: Int64[Tensor, "n"]) -> None:
        """Configure filters, and keep their prototypes and the range of their responses."""
        seen = self.seen(examples.images)
        self.filters.clear()
        found = configure(self.filters, seen, labels, self.prototype_settings, torch.Generator().manual_seed(self.seed))
        self.prototypes.keep(labels=found.labels, images=found.images, points=found.points, pictures=seen[found.images])
        for kind in [REPRESENTATIONS[method] for method in OF_MAXIMA if method in self.machines]:
            positive = examples[kind][examples[kind] > 0]
            least = positive.min().reshape(1) if len(positive) else torch.ones(1)
            self.prototypes.keep(**{f"least_{kind}": least})
        if "tiled" in examples:  # the responses of all filters to all examples are already known
            own = examples["maxima"][found.images, torch.arange(len(self.filters))]
        else:
            own = own_responses(self.filters, seen[found.images])
        self.prototypes.keep(own=own)

    def _svm(
        self,
        features: Callable[[SeenImages], Tensor],
        examples: LabelledSeen,
        held: LabelledSeen | None,
        logarithmic: bool,
    ) -> LinearSVM:
        """Fit an SVM; the norm of logarithms is meaningless, so the scaling ``unit`` is not used for them."""
        chosen = self.comparison
        scalings = tuple(scaling for scaling in chosen.scalings if not (logarithmic and scaling == "unit")) or ("all",)
        known = features(examples[0]), examples[1]
        tuning = (known[0][:0], known[1][:0]) if held is None else (features(held[0]), held[1])
        return svm_of(known, tuning, len(self.classes), chosen.c_values, scalings, chosen.choose_among, self.seed)

    def _fine_tune(
        self, tuned: Cosfire, examples: SeenImages, labels: Int64[Tensor, "n"], held: LabelledSeen | None
    ) -> None:
        """Fine-tune a copy of the filters, starting from the SVM on their log-maxima; as a control, that SVM alone."""
        maxima, settings = examples["maxima"], self.comparison.fine_tuning
        svm = self._svm(lambda seen: log_maxima(seen["maxima"]), (examples, labels), held, logarithmic=True)
        start = LinearLayer(torch.from_numpy(svm.weights), torch.from_numpy(svm.bias))

        def order() -> torch.Generator:
            return torch.Generator().manual_seed(self.seed)

        alone = tune_layer(start, maxima, labels, settings, order())
        with self.show("fine-tuning") as progress:
            found = fine_tune(
                self.filters,
                self._make_filters,
                start,
                maxima,
                self.seen(examples.images),
                labels,
                settings,
                order(),
                progress,
            )
        tuned.load_state_dict(found.filters.state_dict())
        self._layers()["cosfire_tuned"].keep_layer(found)
        self._layers()["layer_tuned"].keep_layer(alone)

    # -- the features of methods ---------------------------------------------------------------------------------------

    def seen(self, images: UInt8[Tensor, "n c h w"]) -> UInt8[Tensor, "n k h w"]:
        """Images as input to the filters: in grey (luma) if the filters operate on images themselves."""
        if images.shape[1] == 1 or not isinstance(self.filters.bank, (GaborBank, DoGBank)):
            return images
        luma = torch.from_numpy(LUMA)[:, None, None]
        return torch.cat([(batch * luma).sum(1, keepdim=True).round().byte() for batch in images.split(256)])

    def _look_at(self, images: UInt8[Tensor, "n c h w"]) -> SeenImages:
        return SeenImages(images, self._represent)

    def _features_of(self, method: Method, seen: SeenImages) -> Float[Tensor, "n d"]:
        """The features of images that a method uses."""
        kind = REPRESENTATIONS[method]
        if method in OF_MAXIMA and self.comparison.logarithms:
            return seen[kind].clamp(min=float(self.prototypes[f"least_{kind}"])).log()
        return seen[kind]

    def _represent(self, kind: Representation, seen: SeenImages) -> Float[Tensor, "n d"]:
        if kind == "maxima":
            maxima: Tensor = seen["tiled"].unflatten(1, (len(self.filters), -1)).amax(2)
            return maxima
        if kind in ("tiled", "tuned"):
            filters = self.filters if kind == "tiled" else self.tuned
            assert filters is not None
            tiles = self.comparison.tiles if kind == "tiled" and "tiled_svm" in self.methods else 1
            with self.show("filtering") as progress:
                return filter_maxima(filters, self.seen(seen.images), progress, tiles=tiles)
        if kind == "descriptor":
            assert self.describe is not None
            return torch.from_numpy(self.describe(seen.images.permute(0, 2, 3, 1).contiguous().numpy()))
        if kind == "logits":
            return self._logits(seen.images)
        assert self.features is not None
        return feature_maps(self.features, seen.images, "pooled" if kind == "pooled" else "full")

    def _logits(self, images: UInt8[Tensor, "n c h w"]) -> Float[Tensor, "n k"]:
        assert self.network is not None
        device = next(self.network.parameters()).device
        with torch.no_grad():
            batches = (batch.to(device).float() / 255 for batch in images.split(256))
            return torch.cat([self.network(batch).cpu() for batch in batches])

    # -- classifying ---------------------------------------------------------------------------------------------------

    def scores(
        self, images: UInt8[Tensor, "n c h w"], methods: Sequence[Method] | None = None
    ) -> dict[Method, Float[Tensor, "n k"]]:
        """Scores of each image for each class, by method; on the CPU, -inf for a class without an example.

        Args:
            images: bytes, on the CPU.
            methods: a selection of :attr:`methods`; None for all.
        """
        seen, examples = self._look_at(images), self._look_at(self.known["images"].cpu())
        return {method: self._scores_of(method, seen, examples) for method in methods or self.methods}

    def first_scores(self, images: UInt8[Tensor, "n c h w"]) -> Float[Tensor, "n k"]:
        """:meth:`scores` of the first method, which is used for prediction."""
        method = self.methods[0]
        return self.scores(images, [method])[method]

    def answers(self, images: UInt8[Tensor, "n c h w"]) -> dict[Method, Int64[ndarray, "n"]]:
        """The class that each method predicts for each image."""
        return {method: scores.argmax(1).numpy() for method, scores in self.scores(images).items()}

    def _scores_of(self, method: Method, seen: SeenImages, examples: SeenImages) -> Float[Tensor, "n k"]:
        features = self._features_of(method, seen)
        if method in self.machines:
            return torch.from_numpy(self._svms()[method].svm().scores(features.double().numpy()))
        if method in TUNED:
            return self._layers()[method].layer().scores(log_maxima(features))
        if method == "strongest_filter":
            own, labels = self.prototypes["own"].cpu(), self.prototypes["labels"].cpu()
            return strongest_filter(features, own, labels, len(self.classes))
        if method in OF_EXAMPLES:
            among = self._features_of(method, examples)
            if method == "nearest_short":
                features, among = principal_components(features, among, examples["descriptor"].shape[1])
            return nearest_example(features, among, self.known["labels"].cpu(), len(self.classes))
        return features

    # -- what was fitted -----------------------------------------------------------------------------------------------

    def configured_from(self) -> Prototypes:
        """The prototypes that the filters were configured from."""
        return Prototypes(*(self.prototypes[name].cpu() for name in ("labels", "images", "points")))

    def facts(self) -> dict[str, Any]:
        """Numbers of filters, parts and weights, and how each SVM was fitted.

        Weights are those of the network, or those of the feature map if that is from another run.
        """
        weighing = self.features if self.network is None else self.network
        svms = {name: kept.svm() for name, kept in self._svms().items()}
        found = {
            "filters": len(self.filters),
            "parts": len(self.filters.rho),
            "parameters": 0 if weighing is None else sum(weight.numel() for weight in weighing.parameters()),
            "prices": {name: svm.c for name, svm in svms.items()},
            "scalings": {name: svm.scaling for name, svm in svms.items()},
        }
        losses = {name: kept["losses"].tolist() for name, kept in self._layers().items()}
        return found | ({"tuning_losses": losses} if losses else {})

    def _svms(self) -> dict[Method, LearntSVM]:
        return cast(dict[Method, LearntSVM], dict(self.machines.items()))

    def _layers(self) -> dict[Method, LearntLayer]:
        return cast(dict[Method, LearntLayer], dict(self.tuned_layers.items()))
