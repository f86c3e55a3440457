"""A linear support vector machine over feature vectors, one class against the rest."""

from dataclasses import dataclass
from itertools import product
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

Scaling = Literal["all", "each", "unit"]
SCALINGS: tuple[Scaling, ...] = get_args(Scaling)
#: features, from which on a machine is fitted in the dual, and how well: LIBLINEAR's own tolerance
MANY, TOLERANCE = 100, 0.1
#: times fewer images than features, from which on features are counted along the images
FEWER = 2


@dataclass(frozen=True)
class LinearSVM:
    """Scores ``x @ weights.T + bias``, the largest of which wins; with scaling ``unit`` of x brought to length 1.

    Attributes:
        c: the price of an error that it was fitted with.
        scaling: of the features.
    """

    weights: Float[ndarray, "k d"]
    bias: Float[ndarray, "k"]
    c: float
    scaling: Scaling = "all"

    @classmethod
    def fit(
        cls,
        features: Float[ndarray, "n d"],
        labels: Int64[ndarray, "n"],
        count: int,
        c: float = 1.0,
        seed: int = 0,
        scaling: Scaling = "all",
    ) -> "LinearSVM":
        """Fit to ``labels`` in [0, count); classes of which there is no image never win.

        Features are brought to mean 0 and deviation 1 first, and the weights take that in: errors then cost the same
        whatever the features' unit.

        Args:
            features, labels: of images.
            count: of classes.
            c: price of an error.
            seed: of the order in which images are gone through.
            scaling: ``all`` features are divided by one deviation, so that what hardly ever differs stays small; or
                ``each`` by its own, for features of several units; ``unit``: as ``all``, of images brought to length 1,
                so that only the direction of their features counts.

        Raises:
            ValueError: all images are of one class.
        """
        from sklearn.svm import LinearSVC

        present = np.unique(labels)
        if len(present) < 2:
            raise ValueError("a machine needs images of two classes at least")
        features = _at_unit_length(features) if scaling == "unit" else features
        mean, deviation = features.mean(0), features.std(0)
        # what differs by rounding alone would be blown up by its own deviation
        differs = deviation > 1e-6 * np.abs(features).max(0)
        if scaling != "each":
            deviation = np.full_like(deviation, np.sqrt(np.square(deviation[differs]).mean()) if differs.any() else 1.0)
        deviation = np.where(differs, deviation, np.inf)
        scaled = (features - mean) / deviation
        # weights are sums of images: of few images with many numbers the machine needs only how these lie to each other
        basis = np.linalg.qr(scaled.T)[0] if FEWER * len(features) < features.shape[1] else None
        seen = scaled if basis is None else scaled @ basis
        # of many numbers the dual problem is several times quicker, and as good, even of more images than numbers
        options = {"dual": True, "tol": TOLERANCE} if seen.shape[1] > MANY else {"dual": "auto"}
        machine = LinearSVC(C=c, random_state=seed, max_iter=5000, **options)
        machine.fit(seen, labels)
        found = (machine.coef_ if basis is None else machine.coef_ @ basis.T) / deviation
        offsets = machine.intercept_ - found @ mean
        if len(present) == 2:  # one machine tells two classes apart
            found, offsets = np.concatenate([-found, found]), np.concatenate([-offsets, offsets])
        weights = np.zeros((count, features.shape[1]))
        bias = np.full(count, -np.inf)
        weights[present], bias[present] = found, offsets
        return cls(weights, bias, c, scaling)

    @classmethod
    def choose(
        cls,
        train: tuple[Float[ndarray, "n d"], Int64[ndarray, "n"]],
        validation: tuple[Float[ndarray, "m d"], Int64[ndarray, "m"]],
        count: int,
        prices: tuple[float, ...],
        seed: int = 0,
        scalings: tuple[Scaling, ...] = ("all",),
    ) -> "LinearSVM":
        """The machine with most right answers on the validation images; of equals the first scaling, lowest price."""
        machines = [cls.fit(*train, count, c, seed, scaling) for scaling, c in product(scalings, sorted(prices))]
        if len(machines) == 1:
            return machines[0]
        features, labels = validation
        right = [float((machine.scores(features).argmax(1) == labels).mean()) for machine in machines]
        return machines[int(np.argmax(right))]

    def scores(self, features: Float[ndarray, "n d"]) -> Float[ndarray, "n k"]:
        """How much each image looks like each class."""
        seen = _at_unit_length(features) if self.scaling == "unit" else features
        return np.asarray(seen @ self.weights.T + self.bias)


def _at_unit_length(features: Float[ndarray, "n d"]) -> Float[ndarray, "n d"]:
    """Rows of length 1; what is nothing stays nothing."""
    length = np.linalg.norm(features, axis=1, keepdims=True)
    return features / np.where(length > 0, length, 1.0)
