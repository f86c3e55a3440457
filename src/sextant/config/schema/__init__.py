"""The typed config behind the YAML files: types, ranges, and rules across keys.

Each part that Sextant ships has a model, chosen by its ``_target_``: those of all tasks here, those of a chapter in
its ``config.py``. The user's own ``_target_`` is legal everywhere; its arguments are checked against its signature when
it is built.
"""

from sextant.config.schema.run import Config

__all__ = ["Config"]
