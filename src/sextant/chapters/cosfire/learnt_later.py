"""Arrays of a module whose sizes are known only after fitting, kept in its checkpoints."""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from sextant.baselines.linear_svm import SCALINGS, LinearSVM
from sextant.chapters.cosfire.fine_tuning import LinearLayer, TunedLayer


class LearntLater(nn.Module):
    """Named arrays that can be set, saved and loaded in any size; empty until then."""

    def __init__(self, *names: str):
        super().__init__()
        for name in names:
            self.register_buffer(name, torch.zeros(0))

    def keep(self, **arrays: Tensor) -> None:
        """Set arrays by name."""
        for name, array in arrays.items():
            setattr(self, name, array.to(next(self.buffers()).device))

    def __getitem__(self, name: str) -> Tensor:
        return self.get_buffer(name)

    def _load_from_state_dict(self, state_dict: Mapping[str, Any], prefix: str, *rest: Any) -> None:
        for name, known in list(self.named_buffers()):
            if (array := state_dict.get(prefix + name)) is not None:
                setattr(self, name, torch.empty_like(array, device=known.device))
        super()._load_from_state_dict(state_dict, prefix, *rest)


class LearntSVM(LearntLater):
    """An SVM; checkpoints call its C ``price``."""

    def __init__(self) -> None:
        super().__init__("weights", "bias", "price", "scaling")

    def keep_svm(self, svm: LinearSVM) -> None:
        """Keep all arrays."""
        self.keep(
            weights=torch.from_numpy(svm.weights),
            bias=torch.from_numpy(svm.bias),
            price=torch.tensor([svm.c], dtype=torch.float64),
            scaling=torch.tensor([SCALINGS.index(svm.scaling)]),
        )

    def svm(self) -> LinearSVM:
        """The SVM as kept."""
        weights, bias, c, scaling = (self[name].cpu().numpy() for name in ("weights", "bias", "price", "scaling"))
        return LinearSVM(weights, bias, float(c[0]), SCALINGS[int(scaling[0])])


class LearntLayer(LearntLater):
    """A fine-tuned linear layer, and the losses of its epochs."""

    def __init__(self) -> None:
        super().__init__("weights", "bias", "losses")

    def keep_layer(self, tuned: TunedLayer) -> None:
        """Keep all arrays."""
        losses = torch.tensor(tuned.losses, dtype=torch.float64)
        self.keep(weights=tuned.layer.weights, bias=tuned.layer.bias, losses=losses)

    def layer(self) -> LinearLayer:
        """The layer as kept."""
        return LinearLayer(self["weights"], self["bias"])
