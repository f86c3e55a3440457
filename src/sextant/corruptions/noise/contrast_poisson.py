"""Loss of contrast followed by photon noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from sextant.corruptions.corruption import Corruption
from sextant.corruptions.seeding import generators, image_seeds


@dataclass(frozen=True)
class ContrastPoisson(Corruption[list[int]]):
    """``y = Poisson(peak · z) / peak`` with ``z = (x - 1/2) · contrast + 1/2``.

    Source: Strisciuglio et al. 2020, section 4.1 (MNIST). The paper does not state the Poisson scale; ``peak = 256``
    counts at white is what scikit-image's ``random_noise`` uses on an 8-bit image.

    >>> darker = ContrastPoisson([0.5])(torch.ones(1, 1, 28, 28), level=0.5, indices=[0], seed=0)
    >>> darker.mean()  # 1/2 + 0.5 / 2
    tensor(0.7482)

    Args:
        levels: contrast factors in (0, 1]; 1 leaves the contrast as it is.
        peak: photon count of a white pixel, above 0.
        clip: clip the result to [0, 1].
        name: the corruption's name.
    """

    levels: Sequence[float]
    peak: float = 256.0
    clip: bool = False
    name: str = "contrast_poisson"

    def check_level(self, level: float) -> None:
        """Raise a ``ValueError`` unless ``level`` is a contrast factor."""
        super().check_level(level)
        if not 0 < level <= 1:
            raise ValueError(f"a level of {self.name} is a contrast factor in (0, 1], not {level!r}")

    def draw(self, level: float, indices: Int64[Tensor, "b"], shape: tuple[int, ...], seed: int) -> list[int]:
        """The seeds of the photon streams: counts depend on the image, so the stream is the parameter."""
        return image_seeds(self.name, level, indices, seed)

    def apply(self, images: Float[Tensor, "b c h w"], level: float, params: list[int]) -> Float[Tensor, "b c h w"]:
        """Reduce the contrast by the factor ``level``, then count photons from the drawn streams."""
        rates = (((images - 0.5) * level + 0.5) * self.peak).clamp(min=0).cpu()
        counts = [torch.poisson(rate, generator) for rate, generator in zip(rates, generators(params), strict=True)]
        noisy = (torch.stack(counts) / self.peak).to(images)
        return noisy.clamp(0, 1) if self.clip else noisy
