"""Networks. Each backbone is built from ``in_channels``, ``image_size`` and ``num_classes``, its number of outputs."""

from sextant.models.alexnet import AlexNetCifar, CaffeNet
from sextant.models.calibration_net import CalibrationNet, CalibrationOutput, coordinate_channels
from sextant.models.cost import LayerCost, NetworkCost, network_cost
from sextant.models.densenet_cifar import DenseNetCifar
from sextant.models.efficientnet_lite0 import EfficientNetLite0, efficientnet_lite0_classifier
from sextant.models.feature_map import FeatureMap
from sextant.models.lenet import LeNet
from sextant.models.oriented_cnn import OrientedCNN, OrientedGradients
from sextant.models.place_cnn import LocalContrast, PlaceCNN
from sextant.models.place_net import PlaceNet
from sextant.models.published_checkpoint import PublishedCheckpoint, load_published
from sextant.models.resnet_cifar import ResNetCifar
from sextant.models.robustbench_nets import robustbench_net
from sextant.models.small_vgg import SmallVGG
from sextant.models.standardize import Standardize
from sextant.models.strided_cnn import StridedCNN
from sextant.models.timm_backbone import timm_backbone
from sextant.models.timm_classifier import TimmClassifier
from sextant.models.torchvision_backbone import torchvision_backbone

__all__ = [
    "AlexNetCifar",
    "CaffeNet",
    "CalibrationNet",
    "CalibrationOutput",
    "DenseNetCifar",
    "EfficientNetLite0",
    "FeatureMap",
    "LayerCost",
    "LeNet",
    "LocalContrast",
    "NetworkCost",
    "OrientedCNN",
    "OrientedGradients",
    "PlaceCNN",
    "PlaceNet",
    "PublishedCheckpoint",
    "ResNetCifar",
    "SmallVGG",
    "Standardize",
    "StridedCNN",
    "TimmClassifier",
    "coordinate_channels",
    "efficientnet_lite0_classifier",
    "load_published",
    "network_cost",
    "robustbench_net",
    "timm_backbone",
    "torchvision_backbone",
]
