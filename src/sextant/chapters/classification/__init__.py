"""Classification of images by a trained network."""

from sextant.chapters.classification.classifier import Classified, ImageClassifier

__all__ = ["Classified", "ImageClassifier"]
