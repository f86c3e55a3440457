"""The laser baseline: measurement models of a planar scanner in an occupancy grid."""

from sextant.localization.laser.beam_model import BeamModel
from sextant.localization.laser.likelihood_field import LikelihoodField

__all__ = ["BeamModel", "LikelihoodField"]
