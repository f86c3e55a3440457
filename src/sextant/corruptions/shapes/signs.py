"""Random directions."""

import torch
from jaxtyping import Float64
from torch import Tensor


def random_signs(streams: list[torch.Generator], count: int) -> Float64[Tensor, "b count"]:
    """``count`` values of -1 or 1 from each stream, equally likely.

    Example:
        >>> signs = random_signs([torch.Generator().manual_seed(seed) for seed in (0, 1)], 100)
        >>> signs.shape, signs.unique()
        (torch.Size([2, 100]), tensor([-1.,  1.], dtype=torch.float64))
    """
    signs = [torch.randint(2, (count,), generator=stream) for stream in streams]
    return torch.stack(signs).double() * 2 - 1
