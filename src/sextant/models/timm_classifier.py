"""A timm network that takes images in [0, 1]: timm's own leave the standardisation to the caller."""

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor, nn

from sextant.models.standardize import Standardize
from sextant.models.timm_backbone import timm_backbone
from sextant.ranges import Positive, checked


class TimmClassifier(nn.Module):
    """Standardises images and classifies them.

    Args:
        in_channels: channels of the image.
        image_size: height and width; networks of a fixed input size are built for it.
        num_classes: number of logits.
        name: name of the network in timm.
        mean, std: by channel; timm's config of the network has those of its weights.

    Raises:
        UserError: as :func:`~sextant.models.timm_backbone`.

    Example:
        >>> network = TimmClassifier(3, (32, 32), 7, name="resnet10t", mean=[0.5] * 3, std=[0.5] * 3)  # doctest: +SKIP
    """

    @checked
    def __init__(
        self,
        in_channels: int,
        image_size: tuple[int, int],
        num_classes: int,
        *,
        name: str,
        mean: Sequence[float],
        std: Sequence[Positive],
    ):
        super().__init__()
        self.standardize = Standardize(in_channels, mean, std)
        self.network = timm_backbone(name, in_channels, image_size, num_classes)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b k"]:
        """Class logits of images in [0, 1]."""
        return self.network(self.standardize(x))  # type: ignore[no-any-return]
