"""Arrays of a module whose sizes are known only once it has been fitted, kept in its checkpoints."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn


class LearntLater(nn.Module):
    """Named arrays that may be set, saved and loaded in any size; missing until then."""

    def __init__(self, *names: str):
        super().__init__()
        for name in names:
            self.register_buffer(name, torch.zeros(0))

    def keep(self, **arrays: Tensor) -> None:
        """Set arrays that were named."""
        for name, array in arrays.items():
            setattr(self, name, array.to(next(self.buffers()).device))

    def __getitem__(self, name: str) -> Tensor:
        return self.get_buffer(name)

    def _load_from_state_dict(self, state_dict: Mapping[str, Any], prefix: str, *rest: Any) -> None:
        for name, known in list(self.named_buffers()):
            if (array := state_dict.get(prefix + name)) is not None:
                setattr(self, name, torch.empty_like(array, device=known.device))
        super()._load_from_state_dict(state_dict, prefix, *rest)
