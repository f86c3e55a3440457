"""COSFIRE filters, configured from one example, over Gabor filters, differences of Gaussians or networks' features."""

from sextant.layers.cosfire.b_cosfire import BCosfire
from sextant.layers.cosfire.banks import Bank, DoGBank, FeatureBank, GaborBank, SteerableBank, VectorBank, gabor_kernel
from sextant.layers.cosfire.blur import Blur, Border, gaussian_blur, max_blur
from sextant.layers.cosfire.cosfire import Cosfire
from sextant.layers.cosfire.keypoints import Keypoint, keypoints
from sextant.layers.cosfire.presets import PRESETS, preset
from sextant.layers.cosfire.strategies import ChannelPeaks, ConcentricCircles, Strategy, VectorKeypoints
from sextant.layers.cosfire.tolerance import Move, Tolerance
from sextant.layers.cosfire.tuples import Mean, Tuples, weighted_mean

__all__ = [
    "PRESETS",
    "BCosfire",
    "Bank",
    "Blur",
    "Border",
    "ChannelPeaks",
    "ConcentricCircles",
    "Cosfire",
    "DoGBank",
    "FeatureBank",
    "GaborBank",
    "Keypoint",
    "Mean",
    "Move",
    "SteerableBank",
    "Strategy",
    "Tolerance",
    "Tuples",
    "VectorBank",
    "VectorKeypoints",
    "gabor_kernel",
    "gaussian_blur",
    "keypoints",
    "max_blur",
    "preset",
    "weighted_mean",
]
