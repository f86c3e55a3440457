"""The difficulty of a pair of traverses: statistics for comparing rendered places with real ones."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from sextant.baselines import Hog, PatchNormalised, Pixels, WhitenedPCA, grey_images
from sextant.evaluation.positives import Positives
from sextant.evaluation.retrieval import RetrievalProtocol, recall
from sextant.retrieval.nearest import Similarity, nearest_neighbours

ALONG_TRACK_LAGS = (1, 2, 5, 10, 50)
CROSS_LAGS = (0, 1)
RESIDUAL_LAGS = (1, 5, 20)
CHUNK = 512


@dataclass(frozen=True)
class ImageStatistics:
    """Statistics of all pixels of one traverse; intensity in [0, 1].

    Attributes:
        intensity_mean, intensity_sd: of the luma.
        gradient_mean, gradient_median, gradient_p90, gradient_p99: of the gradient magnitude (central differences, per
            pixel) inside the images; the percentiles to 0.0003.
        spectral_slope: of log power against log frequency; about -2 for photographs, 0 for white noise.
    """

    intensity_mean: float
    intensity_sd: float
    gradient_mean: float
    gradient_median: float
    gradient_p90: float
    gradient_p99: float
    spectral_slope: float


@dataclass(frozen=True)
class ResidualStatistics:
    """Statistics of the residuals r_t, after subtracting their mean; nan if all are zero.

    Attributes:
        participation: ``(Σλ)² / Σλ²`` of their covariance's eigenvalues: the effective number of dimensions. It grows
            with the number of frames until that is many times the dimension.
        autocorrelation: ``mean(r_t · r_{t+lag}) / mean(||r||²)`` for each lag.
        energy_spread: ``sd(||r||²) / mean(||r||²)``; ``sqrt(2 / d)`` for d independent Gaussians of one variance.
    """

    participation: float
    autocorrelation: dict[int, float]
    energy_spread: float


@dataclass(frozen=True)
class PlaceStatistics:
    """Statistics of two aligned traverses.

    Attributes:
        frames: number in each traverse.
        along_track: mean cosine of reference descriptors at each lag in frames.
        cross_condition: mean cosine of a query and the reference descriptor at each lag in frames.
        residual: statistics of query minus reference descriptor at the same place.
        recall: recall@1 of each training-free descriptor, by name with the protocol.
        reference_images, query_images: statistics of the images themselves.
    """

    frames: int
    along_track: dict[int, float]
    cross_condition: dict[int, float]
    residual: ResidualStatistics
    recall: dict[str, float]
    reference_images: ImageStatistics
    query_images: ImageStatistics

    def rows(self) -> dict[str, float]:
        """Every statistic under a name of its own, in a fixed order."""
        return {
            "frames": self.frames,
            **{f"along-track correlation, lag {lag}": value for lag, value in self.along_track.items()},
            **{f"cross-condition correlation, lag {lag}": value for lag, value in self.cross_condition.items()},
            "residual participation": self.residual.participation,
            **{f"residual autocorrelation, lag {lag}": r for lag, r in self.residual.autocorrelation.items()},
            "residual energy spread": self.residual.energy_spread,
            **self.recall,
            **{f"reference {name.replace('_', ' ')}": v for name, v in asdict(self.reference_images).items()},
            **{f"query {name.replace('_', ' ')}": v for name, v in asdict(self.query_images).items()},
        }


def place_statistics(
    reference: UInt8[ndarray, "n h1 w1 c1"],
    query: UInt8[ndarray, "n h2 w2 c2"],
    *,
    tolerance: int = 1,
    dimensions: int = 128,
    height: int = 32,
    width: int = 64,
) -> PlaceStatistics:
    """Compare two traverses whose images at one place share an index.

    The correlations and residuals are those of ``WhitenedPCA`` descriptors, fitted on the reference. Compare only
    traverses of similar length: recall falls and participation rises with it.

    Args:
        reference, query: one image a frame, in the order of the route.
        tolerance: tolerance of recall@1, in frames.
        dimensions: dimensions of the whitened descriptor.
        height, width: size in pixels to which all images are resized.

    Raises:
        ValueError: the traverses differ in length, have no more frames than the largest lag, or span fewer than
            ``dimensions`` directions.
    """
    shortest = max(ALONG_TRACK_LAGS) + 1
    if len(reference) != len(query) or len(reference) < shortest:
        raise ValueError(
            f"need as many frames in both traverses, at least {shortest}; got {len(reference)} and {len(query)}"
        )
    whitened = WhitenedPCA(height, width, dimensions)
    kinds = {
        "pixels": Pixels(height, width),
        "patch_normalised": PatchNormalised(height, width),
        "hog": Hog(height, width),
        "whitened_pca": whitened,
    }
    recalled = {}
    for name, kind in kinds.items():
        kind.fit(reference)
        places, views = kind.describe(reference), kind.describe(query)
        key = f"{RetrievalProtocol(tolerance).name('R@1')} {name}"
        recalled[key] = recall_within_frames(places, views, tolerance, kind.similarity)
    places, views = whitened.describe(reference), whitened.describe(query)
    return PlaceStatistics(
        frames=len(reference),
        along_track={lag: _mean_product(places, places, lag) for lag in ALONG_TRACK_LAGS},
        cross_condition=cross_condition(places, views),
        residual=residual_statistics(views - places),
        recall=recalled,
        reference_images=image_statistics(reference, height, width),
        query_images=image_statistics(query, height, width),
    )


def recall_within_frames(
    reference: Float32[ndarray, "n d"],
    query: Float32[ndarray, "n d"],
    tolerance: int = 1,
    similarity: Similarity = "cosine",
) -> float:
    """Recall@1 over all queries of aligned traverses; chance is about ``(2 tolerance + 1) / n``.

    >>> ride = np.eye(4, dtype=np.float32)
    >>> recall_within_frames(ride, np.roll(ride, 1, axis=1))  # each looks like the next, the last like the first
    0.75
    """
    frames = np.arange(len(query))
    nearest = nearest_neighbours(reference, query, 1, similarity)
    return recall(nearest, Positives.within_frames(frames, frames, tolerance), (1,)).over_all[1]


def cross_condition(
    reference: Float32[ndarray, "n d"], query: Float32[ndarray, "n d"], lags: Sequence[int] = CROSS_LAGS
) -> dict[int, float]:
    """Mean of ``query_t · reference_{t ± lag}`` over t and both signs, for unit-norm descriptors."""
    both = {lag: (_mean_product(query, reference, lag), _mean_product(reference, query, lag)) for lag in lags}
    return {lag: (forward + backward) / 2 for lag, (forward, backward) in both.items()}


def residual_statistics(residual: Float32[ndarray, "n d"], lags: Sequence[int] = RESIDUAL_LAGS) -> ResidualStatistics:
    """The spread of residuals over dimensions, along the track and in size; equations in ``ResidualStatistics``."""
    centred = residual.astype(np.float64) - residual.mean(axis=0, dtype=np.float64)
    energy = np.einsum("nd,nd->n", centred, centred)
    if energy.max() <= np.finfo(np.float32).eps:
        return ResidualStatistics(float("nan"), dict.fromkeys(lags, float("nan")), float("nan"))
    covariance = centred.T @ centred / len(centred)
    return ResidualStatistics(
        participation=float(np.trace(covariance) ** 2 / (covariance**2).sum()),
        autocorrelation={lag: _mean_product(centred, centred, lag) / float(energy.mean()) for lag in lags},
        energy_spread=float(energy.std() / energy.mean()),
    )


def image_statistics(images: UInt8[ndarray, "n h w c"], height: int = 32, width: int = 64) -> ImageStatistics:
    """Intensity, gradients and spectrum of a traverse, at one image size."""
    edges = np.linspace(0, np.sqrt(0.5), 2049)  # central differences are at most 1/2 in each direction
    counts, gradient, total, squares = np.zeros(len(edges) - 1), 0.0, 0.0, 0.0
    power = np.zeros((height, width))
    for start in range(0, len(images), CHUNK):
        grey = grey_images(images[start : start + CHUNK], height, width).astype(np.float64)
        total, squares = total + grey.sum(), squares + (grey**2).sum()
        down, right = (grey[:, 2:, 1:-1] - grey[:, :-2, 1:-1]) / 2, (grey[:, 1:-1, 2:] - grey[:, 1:-1, :-2]) / 2
        magnitude = np.hypot(down, right)
        gradient += magnitude.sum()
        counts += np.histogram(magnitude, edges)[0]
        power += power_spectrum(grey).sum(axis=0)
    pixels = len(images) * height * width
    median, p90, p99 = (float(edges[1:][np.searchsorted(counts.cumsum(), q * counts.sum())]) for q in (0.5, 0.9, 0.99))
    mean = total / pixels
    return ImageStatistics(
        intensity_mean=float(mean),
        intensity_sd=float(np.sqrt(max(squares / pixels - mean**2, 0))),
        gradient_mean=float(gradient / counts.sum()),
        gradient_median=median,
        gradient_p90=p90,
        gradient_p99=p99,
        spectral_slope=spectral_slope(power),
    )


def power_spectrum(grey: ndarray) -> ndarray:
    """``|DFT|²`` of each image (n, h, w) about its mean, under a Hann window in both directions."""
    window = np.outer(np.hanning(grey.shape[1] + 2)[1:-1], np.hanning(grey.shape[2] + 2)[1:-1])
    mean = (grey * window).sum(axis=(1, 2), keepdims=True) / window.sum()
    return np.asarray(np.abs(np.fft.fft2((grey - mean) * window)) ** 2)


def spectral_slope(power: ndarray) -> float:
    """Slope of log power against log frequency, for a spectrum (h, w) in the order of ``numpy.fft.fft2``.

    Least squares over rings of frequency ``1/min(h, w)`` wide, from the third, which the window's leakage from the mean
    does not reach, up to 1/2 cycle per pixel; nan for images without structure.
    """
    height, width = power.shape
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width))  # (h, w), cycles per pixel
    ring = np.rint(frequency * min(height, width)).astype(int).ravel()
    chosen = slice(3, min(height, width) // 2 + 1)
    count = np.bincount(ring)[chosen]
    mean_power = np.bincount(ring, power.ravel())[chosen] / count
    mean_frequency = np.bincount(ring, frequency.ravel())[chosen] / count
    if len(mean_power) < 2 or mean_power.min() <= 1e-12 * power.size:
        return float("nan")
    return float(np.polyfit(np.log(mean_frequency), np.log(mean_power), 1)[0])


def _mean_product(first: ndarray, second: ndarray, lag: int) -> float:
    """Mean of ``first_t · second_{t+lag}``."""
    return float(np.einsum("nd,nd->n", first[: len(first) - lag], second[lag:], dtype=np.float64).mean())
