"""Trained networks that come with the package, each in two files of this folder.

``<name>.safetensors`` has the weights, in half precision where that changes no figure; ``<name>.json`` is its card:
what it was trained on and how, what it scores, and what builds it. The card states the SHA-256 of the weights, which is
checked whenever they are read. Another model is two more files, written by :func:`~sextant.zoo.files.write_model`;
nothing else lists them. ``run=zoo:<name>`` opens one wherever a run is taken. What localizes has a folder of its name
besides, with its map.
"""

from sextant.zoo.files import PREFIX, model_file, names, read_card, read_model, write_model

__all__ = ["PREFIX", "model_file", "names", "read_card", "read_model", "write_model"]
