"""Training batches with an augmentation applied."""

import torch
from torch import Tensor
from torch.utils.data import Dataset

from sextant.data.augmentation.augmentation import Augmentation
from sextant.data.batches import Batch, ImageBatches


class AugmentedBatches(Dataset[Batch]):
    """Augmented images by number: ``i + epoch * n`` is image i of n as shown in that epoch.

    Args:
        images: the training split.
        augmentation: the change applied to them.
        seed: of the augmentation.
    """

    def __init__(self, images: ImageBatches, augmentation: Augmentation, seed: int):
        self.images, self.augmentation, self.seed = images, augmentation, seed

    def __len__(self) -> int:
        return len(self.images)

    def __getitem__(self, numbers: list[int] | Tensor) -> Batch:
        """A batch of one epoch."""
        chosen = torch.as_tensor(numbers)
        epoch = int(chosen[0]) // len(self)
        batch = self.images[chosen % len(self)]
        images = self.augmentation(batch.images, batch.indices, epoch, self.seed)
        return Batch(images, batch.labels, batch.indices)
