"""Moments of a belief."""

import torch

from sextant.geometry.planar import wrap_angle


def mean_over_all(belief):
    """Mean and covariance of each run over all particles, with the mean heading of the circle."""
    weights, poses, turned = belief.weights[..., None], belief.poses, belief.poses[..., 2:]
    heading = torch.atan2((weights * turned.sin()).sum(1), (weights * turned.cos()).sum(1))
    mean = torch.cat([(weights * poses[..., :2]).sum(1), heading], dim=1)
    apart = poses - mean[:, None]
    apart[..., 2] = wrap_angle(apart[..., 2])
    return mean, (weights * apart).mT @ apart
