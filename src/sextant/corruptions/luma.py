"""The brightness of a colour image as one channel."""

from jaxtyping import Float
from torch import Tensor

#: weights of red, green and blue in ITU-R BT.601, which Pillow's ``L`` and OpenCV's grey conversion use
WEIGHTS = (0.299, 0.587, 0.114)


def luma(images: Float[Tensor, "*batch c h w"]) -> Float[Tensor, "*batch 1 h w"]:
    """``0.299 R + 0.587 G + 0.114 B``; an image of one channel is its own luma.

    Raises:
        ValueError: the images have neither one channel nor three.
    """
    channels = images.shape[-3]
    if channels == 1:
        return images
    if channels != 3:
        raise ValueError(f"images have 1 or 3 channels, not {channels}")
    return (images * images.new_tensor(WEIGHTS)[:, None, None]).sum(-3, keepdim=True)
