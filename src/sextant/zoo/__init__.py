"""Trained networks that come with the package, each in two files of this folder.

``<name>.safetensors`` has the weights, in half precision where that changes no metric; ``<name>.json`` is its card:
its training data and procedure, its metrics, and what builds it. The card states the SHA-256 of the weights, which is
checked whenever they are read. A model is added by :func:`~sextant.zoo.files.write_model`, as two more files.
``run=zoo:<name>`` is accepted wherever a run is. A localization model also has a folder of its name, with its map.
"""

from sextant.zoo.files import PREFIX, model_file, names, read_card, read_model, write_model

__all__ = ["PREFIX", "model_file", "names", "read_card", "read_model", "write_model"]
