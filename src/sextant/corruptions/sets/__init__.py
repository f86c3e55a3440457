"""The corruptions of the published benchmark sets, with their parameters."""

from sextant.corruptions.sets.cifar10_c import CIFAR10_C, CIFAR100_C
from sextant.corruptions.sets.imagenet_c import IMAGENET_C
from sextant.corruptions.sets.mnist_c import MNIST_C

__all__ = ["CIFAR10_C", "CIFAR100_C", "IMAGENET_C", "MNIST_C"]
