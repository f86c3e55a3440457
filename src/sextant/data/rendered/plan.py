"""The plan of a rendered dataset: what it consists of, and how any part of it is rendered."""

import hashlib
import json
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import DTypeLike

from sextant.errors import UserError

NAME = re.compile(r"[A-Za-z0-9_-]+")


@dataclass(frozen=True)
class ArraySpec:
    """Shape and type of one item of an array; the array itself is ``(count, *shape)``."""

    shape: tuple[int, ...]
    dtype: DTypeLike

    def __post_init__(self) -> None:
        if any(size < 1 for size in self.shape) or np.dtype(self.dtype).hasobject:
            raise ValueError(f"an array's items need sizes above 0 and a plain dtype, got {self.shape}, {self.dtype}")

    @cached_property
    def item_bytes(self) -> int:
        """Bytes of one item."""
        return math.prod(self.shape) * np.dtype(self.dtype).itemsize


class RenderPlan(ABC):
    """A dataset that can be rendered: its identity, its layout, and a function from indices to items.

    Opening a store that is laid out on disk reads only the three attributes. The properties may need the world and
    should build it on first use (``functools.cached_property``), as should :meth:`render`. A plan that is sent to
    worker processes must be picklable.

    Attributes:
        name: the dataset's name; its store lies in ``<cache>/<name>-<digest8>``.
        config: everything that determines what is rendered, as plain values that JSON can hold.
        source_sha256: hash of the source that renders, see :func:`~sextant.data.rendered.splits.modules_sha256`.
    """

    name: str
    config: Mapping[str, Any]
    source_sha256: str

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of items."""

    @property
    @abstractmethod
    def arrays(self) -> Mapping[str, ArraySpec]:
        """The arrays that :meth:`render` makes for every item, by name."""

    @property
    @abstractmethod
    def facts(self) -> Mapping[str, Any]:
        """Facts about the dataset for the user (street kilometres, splits, ...), as plain values."""

    @property
    def chunk(self) -> int:
        """Number of items rendered, written and journalled together."""
        return 64

    @property
    def columns(self) -> Mapping[str, ndarray]:
        """Small arrays ``(count, ...)`` known without rendering, such as poses and splits."""
        return {}

    @abstractmethod
    def render(self, start: int, stop: int) -> Mapping[str, ndarray]:
        """Render the items from ``start`` up to ``stop``: for each name in ``arrays``, ``(stop - start, *shape)``.

        This must be a pure function of the indices: the same bytes whatever was rendered before and in whichever
        thread; several threads may call it at once.
        """

    @property
    def digest(self) -> str:
        """SHA-256 of config and source, in hexadecimal: two plans with the same digest render the same bytes."""
        return plan_digest(self.config, self.source_sha256)


def plan_digest(config: Mapping[str, Any], source_sha256: str) -> str:
    """SHA-256 of the canonical JSON of a plan's config and the hash of its source."""
    return canonical_sha256({"config": config, "source_sha256": source_sha256})


def canonical_sha256(content: Mapping[str, Any]) -> str:
    """SHA-256 of plain values after a JSON round trip, in canonical form.

    Raises:
        TypeError: a value is not plain.
        ValueError: a number is not finite.
    """
    plain = json.loads(json.dumps(content, allow_nan=False))
    return hashlib.sha256(json.dumps(plain, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def check_plan(plan: RenderPlan) -> None:
    """Check that a plan can be laid out.

    Raises:
        UserError: it has no items.
        ValueError: its parts contradict each other, which is a bug in the dataset's code.
    """
    if plan.count < 1:
        raise UserError(f"dataset {plan.name}: its config describes no items")
    for name in (plan.name, *plan.arrays, *plan.columns):
        if not NAME.fullmatch(name):
            raise ValueError(f"{plan.name}: {name!r} names a file; letters, digits, _ and - are allowed")
    if not plan.arrays or plan.chunk < 1:
        raise ValueError(f"{plan.name}: a plan needs at least one array and a chunk of at least 1")
    if twice := set(plan.arrays) & set(plan.columns):
        raise ValueError(f"{plan.name}: {', '.join(sorted(twice))} is both an array and a column")
    for name, column in plan.columns.items():
        if len(column) != plan.count:
            raise ValueError(f"{plan.name}: column {name} has {len(column)} rows for {plan.count} items")


def check_chunk(name: str, found: Mapping[str, ndarray], arrays: Mapping[str, ArraySpec], length: int) -> None:
    """Check that rendered arrays match their plan.

    Raises:
        ValueError: it did not, which is a bug in the dataset's code.
    """
    if set(found) != set(arrays):
        raise ValueError(f"{name}: rendered {sorted(found)}, planned {sorted(arrays)}")
    for array, spec in arrays.items():
        shape, dtype = (length, *spec.shape), np.dtype(spec.dtype)
        if found[array].shape != shape or found[array].dtype != dtype:
            raise ValueError(
                f"{name}: rendered {array} as {found[array].dtype} {found[array].shape}, planned {dtype} {shape}"
            )
