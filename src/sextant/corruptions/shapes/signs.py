"""Random directions."""

import torch
from jaxtyping import Float64
from torch import Tensor


def random_signs(streams: list[torch.Generator], count: int) -> Float64[Tensor, "b count"]:
    """``count`` values of -1 or 1 from each stream, equally likely."""
    signs = [torch.randint(2, (count,), generator=stream) for stream in streams]
    return torch.stack(signs).double() * 2 - 1
