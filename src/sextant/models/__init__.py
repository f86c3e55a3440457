"""Networks. Each backbone is built from ``in_channels``, ``image_size`` and ``num_classes``, the outputs it gives."""

from sextant.models.calibration_net import CalibrationNet, CalibrationOutput, coordinate_channels
from sextant.models.lenet import LeNet
from sextant.models.oriented_cnn import OrientedCNN, OrientedGradients
from sextant.models.strided_cnn import StridedCNN
from sextant.models.timm_backbone import timm_backbone
from sextant.models.torchvision_backbone import torchvision_backbone

__all__ = [
    "CalibrationNet",
    "CalibrationOutput",
    "LeNet",
    "OrientedCNN",
    "OrientedGradients",
    "StridedCNN",
    "coordinate_channels",
    "timm_backbone",
    "torchvision_backbone",
]
