"""The kernel's hyper-parameters, positive and differentiable, and the likelihoods that choose them."""

from sextant.localization.hyperparameters.joint_likelihood import joint_log_likelihood
from sextant.localization.hyperparameters.ordering import random_order
from sextant.localization.hyperparameters.trainable_kernel import TrainableKernel
from sextant.localization.hyperparameters.vecchia import Conditioning, vecchia_log_likelihood

__all__ = [
    "Conditioning",
    "TrainableKernel",
    "joint_log_likelihood",
    "random_order",
    "vecchia_log_likelihood",
]
