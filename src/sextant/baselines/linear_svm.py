"""A linear support vector machine over feature vectors, one class against the rest."""

import warnings
from dataclasses import dataclass
from itertools import product
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

Scaling = Literal["all", "each", "unit"]
#: checkpoints keep their numbers: new ones come last
SCALINGS: tuple[Scaling, ...] = get_args(Scaling)
#: of the dual problem
TOLERANCE = 0.01
#: so many times fewer images than features are looked at in the span of the images
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

        Features are brought to mean 0 and images to a mean squared length of 1 first, and the weights take that in:
        errors then cost the same whatever the features' unit and number.

        Args:
            features, labels: of images.
            count: of classes.
            c: price of an error.
            seed: of the order in which images are gone through.
            scaling: ``all`` features are divided by the same number, so that what hardly ever differs stays small; or
                ``each`` by its own deviation too, for features of several units; ``unit``: as ``all``, of images
                brought to length 1, so that only the direction of their features counts.

        Raises:
            ValueError: all images are of one class.
        """
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.svm import LinearSVC

        present = np.unique(labels)
        if len(present) < 2:
            raise ValueError("a machine needs images of two classes at least")
        features = _at_unit_length(features) if scaling == "unit" else features
        mean, deviation = features.mean(0), features.std(0)
        # what differs by rounding alone would be blown up by its own deviation
        differs = deviation > 1e-6 * np.abs(features).max(0)
        if not differs.any():
            deviation = np.ones_like(deviation)
        elif scaling == "each":
            deviation = deviation * np.sqrt(differs.sum())
        else:
            deviation = np.full_like(deviation, np.sqrt(np.square(deviation[differs]).sum()))
        deviation = np.where(differs, deviation, np.inf)
        scaled = (features - mean) / deviation
        # weights are sums of images: of few images with many numbers the machine needs only how these lie to each other
        basis = np.linalg.qr(scaled.T)[0] if FEWER * len(features) < features.shape[1] else None
        seen = scaled if basis is None else scaled @ basis
        machine = LinearSVC(C=c, random_state=seed, max_iter=5000, dual=True, tol=TOLERANCE)
        with warnings.catch_warnings():
            # what is left to gain after so many rounds is little, and validation images judge what was reached
            warnings.simplefilter("ignore", ConvergenceWarning)
            # one image of each class is what some are to be known by
            warnings.filterwarnings("ignore", "The number of unique classes", UserWarning)
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
        """The machine with most right answers on the validation images; of equals the first scaling, lowest price.

        Raises:
            ValueError: there is something to choose and no validation image, or all images are of one class.
        """
        features, labels = validation
        if not len(labels):
            raise ValueError("without validation images give one price and one scaling to fit with")
        machines = [cls.fit(*train, count, c, seed, scaling) for scaling, c in product(scalings, sorted(prices))]
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
