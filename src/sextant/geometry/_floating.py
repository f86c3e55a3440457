"""Numbers and tensors as floating tensors that agree with each other."""

import torch
from torch import Tensor


def floating(*values: float | Tensor) -> list[Tensor]:
    """Values in the type of the first floating tensor among them, or torch's default, on the device of the first."""
    tensors = [value for value in values if isinstance(value, Tensor)]
    dtype = next((each.dtype for each in tensors if each.is_floating_point()), torch.get_default_dtype())
    device = tensors[0].device if tensors else None
    return [torch.as_tensor(value, dtype=dtype, device=device) for value in values]
