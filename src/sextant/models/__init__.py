"""Networks."""

from sextant.models.lenet import LeNet

__all__ = ["LeNet"]
