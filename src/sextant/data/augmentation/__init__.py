"""Class-preserving augmentation of training images; what an image gets is a function of (seed, epoch, index)."""

from sextant.data.augmentation.augmentation import Augmentation, NoAugmentation
from sextant.data.augmentation.augmented_batches import AugmentedBatches
from sextant.data.augmentation.augmix import AugMix
from sextant.data.augmentation.pad_crop_flip import PadCropFlip

__all__ = ["AugMix", "Augmentation", "AugmentedBatches", "NoAugmentation", "PadCropFlip"]
