"""The typed config behind the YAML files: types, ranges, and rules across keys.

Each config that Sextant ships has a model, chosen by its ``_target_``: here those of all tasks, in ``config.py`` of a
chapter its own. The user's own ``_target_`` is legal everywhere; its arguments are checked against its signature when
it is built.
"""

from sextant.config.schema.run import Config

__all__ = ["Config"]
