"""Config schemas, their validation, and the digest that identifies an experiment."""

from sextant.config.digest import digest, identity
from sextant.config.schema import Config
from sextant.config.validate import nearest, validate

__all__ = ["Config", "digest", "identity", "nearest", "validate"]
