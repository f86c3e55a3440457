"""Constructors are checked against the ranges that the schema has for the keys of configs."""

import inspect
import math
import re
from collections.abc import Sequence
from dataclasses import astuple
from enum import StrEnum
from fractions import Fraction
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
import pytest
import torch
from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf
from frozen import freeze
from pydantic.fields import FieldInfo

from sextant.config.building import named
from sextant.config.schema.parts import Part
from sextant.config.validate import config_classes
from sextant.errors import ArgumentError
from sextant.ranges import WORDS, Count, Positive, Share, checked, fits, is_range, ranges

#: packages that people import without a config
LIBRARY = (
    "baselines", "correspondence", "corruptions", "evaluation", "geometry", "layers", "localization", "losses",
    "models", "retrieval",
)  # fmt: skip


def bounds(kind: Any, metadata: Any = ()) -> set[str]:
    """The limits within an annotation or a field, in an order-free form."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return bounds(inner[0], [*inner[1:], *metadata])
    if origin is Literal:
        return {repr(each) for each in inner}
    flat = [each for one in metadata for each in (one.metadata if isinstance(one, FieldInfo) else [one])]
    own = {repr(each) for each in flat if type(each) in WORDS and not isinstance(each, MinLen)}
    return own if origin is dict else own.union(*(bounds(each) for each in inner if each not in (..., type(None))))


def parts(kind: type[Part] = Part):
    yield kind
    for each in kind.__subclasses__():
        yield from parts(each)


def keys():
    config_classes()
    for kind in parts():
        annotation = kind.model_fields["target"].annotation
        targets = [each for one in (annotation, *get_args(annotation)) for each in get_args(one) if type(each) is str]
        for target in (each for each in targets if each.split(".")[1] in LIBRARY):
            for name, field in kind.model_fields.items():
                if name != "target":
                    yield target, name, bounds(field.annotation, field.metadata)


#: arguments with a wider annotation: images too small for experiments, lenses that no network predicts, and weights of
#: laser beams, which need not sum to 1
WIDER = re.compile(
    r"sextant\.baselines\..*\.(height|width)|sextant\.geometry\.Parameterization\.k2_of_k1|"
    r"sextant\.localization\.laser\..*\.z_\w+"
)


def test_an_argument_has_the_range_of_its_key():
    ranged = [key for key in keys() if key[2]]
    assert len(ranged) > 150
    assert not [f"{target}.{name}" for target, name, allowed in ranged if not checked_alike(target, name, allowed)]


def checked_alike(target, name, allowed):
    make = named(target)
    parameter = inspect.signature(make).parameters.get(name)
    if parameter is None or WIDER.fullmatch(f"{target}.{name}"):
        return True
    checks = make.__init__ if isinstance(make, type) else make
    return bounds(parameter.annotation) == allowed and hasattr(checks, "__wrapped__")


def within(kind: Any) -> Any:
    """A value within a range."""
    one = (1, 0.5, 64, *get_args(kind))
    return next(each for each in (*one, *([each] * n for each in one for n in (1, 2, 3, 4))) if fits(kind, each))


def beyond(bound: Any, kind: type) -> Any:
    """A value just outside of a bound."""
    (limit,) = astuple(bound)
    below, above = (limit - 1, limit + 1) if kind is int else (math.nextafter(limit, s * math.inf) for s in (-1, 1))
    return {Gt: limit, Ge: below, Lt: limit, Le: above, MultipleOf: 3 * limit // 2, MinLen: []}[type(bound)]


def outside(kind: Any) -> list[Any]:
    """Values just outside of a range, and such as are of another type."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        assert inner[1:] == (type(None),)
        return [each for each in outside(inner[0]) if each is not None]
    if origin is Literal:
        return ["no such value", 7, None]
    if origin is Annotated:
        others = outside(inner[0]) or [math.nan, math.inf, -math.inf, "1", True, None, *[2.5] * (inner[0] is int)]
        return [*(beyond(bound, inner[0]) for bound in inner[1:]), *others]
    if origin in (tuple, Sequence):
        right, fixed = within(kind), origin is tuple and ... not in inner
        return [*([*right[1:], each] for each in outside(inner[0])), *[right * 2] * fixed, right[0], None]
    return []


FROZEN = [(name, argument) for name, allowed in freeze.read("ranges.json").items() for argument in allowed]


@pytest.mark.parametrize(("name", "argument"), FROZEN)
def test_a_value_outside_of_any_frozen_range_is_refused(name, argument):
    """Nothing is done before: arguments without a range, and the object itself, may be anything."""
    call = freeze.checked_calls()[name]
    signature, known = ranges(call.__wrapped__)
    needed = [each for each in signature.parameters.values() if each.default is each.empty and each.name != "self"]
    given = {each.name: within(each.annotation) if each.name in known else None for each in needed}
    itself = [None] * ("self" in signature.parameters)
    for value in outside(known[argument].annotation):
        with pytest.raises(ArgumentError, match=rf"^{argument}=.* must be "):
            call(*itself, **given | {argument: value})


@checked
class Loss:
    def __init__(
        self, margin: Positive = 0.5, *, sizes: tuple[Count, Count] = (1, 2), kind: Literal["l1", "l2"] = "l1"
    ):
        self.margin, self.sizes, self.kind = margin, sizes, kind


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"margin": 0}, "margin=0 must be above 0"),
        ({"margin": float("nan")}, "margin=nan must be a number above 0"),
        ({"margin": float("inf")}, "margin=inf must be a finite number above 0"),
        ({"margin": "0.5"}, "margin='0.5' must be a number above 0"),
        ({"margin": True}, "margin=True must be a number above 0"),
        ({"margin": torch.tensor(0.0)}, "must be above 0"),
        ({"sizes": (1, 0)}, r"sizes=\(1, 0\) must be 2 values, each a whole number, at least 1"),
        ({"sizes": (1, 2, 3)}, "2 values"),
        ({"kind": "l3"}, "kind='l3' must be one of l1, l2"),
    ],
)
def test_an_argument_outside_of_its_range(wrong, said):
    with pytest.raises(ArgumentError, match=said) as caught:
        Loss(**wrong)
    assert caught.value.of == "Loss"


class Kind(StrEnum):
    l1 = "l1"


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Positive, [1, np.float32(0.5), np.array(0.5), torch.tensor(0.5), Fraction(1, 2), 10**400]),
        (Count, [np.uint8(3), np.array(3), torch.tensor(3), 10**400]),
        (Sequence[Positive], [[1, 2], (1, 2), range(1, 3), np.array([0.5, 2]), torch.tensor([0.5, 2])]),
        (tuple[Count, Count], [torch.Size([1, 2]), np.array([1, 2])]),
        (Literal["l1"], [np.str_("l1"), Kind.l1]),
        (Literal[-1, 1], [np.int64(1)]),
    ],
)
def test_numbers_of_other_libraries_count(kind, values):
    assert all(fits(kind, value) for value in values)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        (Positive, [True, 1j, "1", b"1", np.array([1.0]), np.array(True), torch.tensor(True)]),
        (Count, [3.0, np.array(3.0), -(10**400)]),
        (Sequence[Positive], ["ab", {1, 2}, {1: 2}, np.ones((2, 2)), np.array(1.0)]),
        (Literal[-1, 1], [True, 1.0]),
    ],
)
def test_other_values_do_not(kind, values):
    assert not any(fits(kind, value) for value in values)


def test_what_is_within_its_range_is_passed_on():
    made = Loss(2, sizes=[3, 4], kind="l2")
    assert (made.margin, made.sizes, made.kind) == (2, [3, 4], "l2")
    with pytest.raises(TypeError, match="unexpected keyword argument 'edge'"):
        Loss(edge=1)
    assert is_range(Share | None)
    assert not is_range(dict[str, int])
    assert fits(Share | None, None)
