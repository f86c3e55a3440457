"""Poolings: from the feature map of an image to one vector, each built from ``channels`` and ``size`` of the map."""

from sextant.models.pooling.average import Average
from sextant.models.pooling.feature_mixer import FeatureMixer
from sextant.models.pooling.flatten import Flatten
from sextant.models.pooling.gem import GeM
from sextant.models.pooling.netvlad import NetVLAD
from sextant.models.pooling.pooling import Pooling

__all__ = ["Average", "FeatureMixer", "Flatten", "GeM", "NetVLAD", "Pooling"]
