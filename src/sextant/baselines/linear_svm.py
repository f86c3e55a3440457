"""A linear one-against-the-rest support vector machine over feature vectors."""

import warnings
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int64
from numpy import ndarray

Scaling = Literal["all", "each", "unit"]
#: checkpoints store their indices: new ones come last
SCALINGS: tuple[Scaling, ...] = get_args(Scaling)
#: tolerance of the dual problem's solver
TOLERANCE = 0.01
#: ratio of features to images above which the SVM is fitted in the span of the images
FEWER = 2


@dataclass(frozen=True)
class LinearSVM:
    """Class scores ``x @ weights.T + bias``, the largest wins; with scaling ``unit``, x is first scaled to norm 1.

    Attributes:
        c: the fitted SVM's C, the weight of an error.
        scaling: scaling of the features.
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
        """Fit to ``labels`` in [0, count); classes without any image never win.

        Features are first centred and images scaled to a mean squared norm of 1, which the weights absorb, so that the
        effect of C does not depend on the unit and number of the features.

        Args:
            features, labels: features and labels of the images.
            count: number of classes.
            c: C, the weight of an error.
            seed: seed of the order in which the solver visits images.
            scaling: ``all``: all features are divided by one number, so that those that hardly vary stay small;
                ``each``: each is standardised, for features of several units; ``unit``: as ``all``, after scaling
                images to norm 1, so that only the direction of their features counts.

        Raises:
            ValueError: all images are of one class.
        """
        return cls._fit(_Scaled.of(features, scaling), labels, count, c, seed)

    @classmethod
    def _fit(cls, images: "_Scaled", labels: Int64[ndarray, "n"], count: int, c: float, seed: int) -> "LinearSVM":
        from sklearn.exceptions import ConvergenceWarning
        from sklearn.svm import LinearSVC

        present = np.unique(labels)
        if len(present) < 2:
            raise ValueError("an SVM needs images of at least two classes")
        svm = LinearSVC(C=c, random_state=seed, max_iter=5000, dual=True, tol=TOLERANCE)
        with warnings.catch_warnings():
            # further iterations gain little, and C is chosen on validation images
            warnings.simplefilter("ignore", ConvergenceWarning)
            # some classes have a single image
            warnings.filterwarnings("ignore", "The number of unique classes", UserWarning)
            svm.fit(images.seen, labels)
        found = (svm.coef_ if images.basis is None else svm.coef_ @ images.basis.T) / images.deviation
        offsets = svm.intercept_ - found @ images.mean
        if len(present) == 2:  # one SVM separates two classes
            found, offsets = np.concatenate([-found, found]), np.concatenate([-offsets, offsets])
        weights = np.zeros((count, found.shape[1]))
        bias = np.full(count, -np.inf)
        weights[present], bias[present] = found, offsets
        return cls(weights, bias, c, images.scaling)

    @classmethod
    def choose(
        cls,
        train: tuple[Float[ndarray, "n d"], Int64[ndarray, "n"]],
        validation: tuple[Float[ndarray, "m d"], Int64[ndarray, "m"]],
        count: int,
        c_values: tuple[float, ...],
        seed: int = 0,
        scalings: tuple[Scaling, ...] = ("all",),
    ) -> "LinearSVM":
        """The SVM with the most correct validation images; ties go to the first scaling and the lowest C.

        Raises:
            ValueError: there is no validation image, or all images are of one class.
        """
        features, labels = validation
        if not len(labels):
            raise ValueError("without validation images give a single C and a single scaling")
        svms = [
            cls._fit(images, train[1], count, c, seed)
            for images in (_Scaled.of(train[0], scaling) for scaling in scalings)
            for c in sorted(c_values)
        ]
        right = [float((svm.scores(features).argmax(1) == labels).mean()) for svm in svms]
        return svms[int(np.argmax(right))]

    def scores(self, features: Float[ndarray, "n d"]) -> Float[ndarray, "n k"]:
        """Scores of every class for each image."""
        seen = _at_unit_length(features) if self.scaling == "unit" else features
        return np.asarray(seen @ self.weights.T + self.bias)


def _at_unit_length(features: Float[ndarray, "n d"]) -> Float[ndarray, "n d"]:
    """Rows of norm 1; zeros stay zeros."""
    length = np.linalg.norm(features, axis=1, keepdims=True)
    return features / np.where(length > 0, length, 1.0)


@dataclass(frozen=True)
class _Scaled:
    """Inputs of the SVM: centred and scaled features, given by their coordinates in ``basis`` if images are few."""

    seen: Float[ndarray, "n k"]
    basis: Float[ndarray, "d k"] | None
    mean: Float[ndarray, "d"]
    deviation: Float[ndarray, "d"]
    scaling: Scaling

    @classmethod
    def of(cls, features: Float[ndarray, "n d"], scaling: Scaling) -> "_Scaled":
        features = _at_unit_length(features) if scaling == "unit" else features
        mean, deviation = features.mean(0), features.std(0)
        # features that differ only by rounding would be inflated by their own deviation
        differs = deviation > 1e-6 * np.abs(features).max(0)
        if not differs.any():
            deviation = np.ones_like(deviation)
        elif scaling == "each":
            deviation = deviation * np.sqrt(differs.sum())
        else:
            deviation = np.full_like(deviation, np.sqrt(np.square(deviation[differs]).sum()))
        deviation = np.where(differs, deviation, np.inf)
        scaled = (features - mean) / deviation
        # weights are sums of images: with few images of many features the SVM needs only their inner products
        basis = np.linalg.qr(scaled.T)[0] if FEWER * len(features) < features.shape[1] else None
        return cls(scaled if basis is None else scaled @ basis, basis, mean, deviation, scaling)
