"""Ranges of arguments, written in the annotations of a constructor and checked when it is called.

A range is written as a type: ``margin: Positive``, ``base: Annotated[float, Ge(-1), Le(1)]``, a ``Literal``, a tuple or
sequence of these, or one of these or None. :func:`checked` raises :class:`~sextant.errors.ArgumentError` for a value
outside of it. The schema of configs uses the same types, and a test compares each of its keys with its argument.
"""

import inspect
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import astuple
from functools import cache, wraps
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MinLen, MultipleOf

from sextant.errors import ArgumentError, shown

Positive = Annotated[float, Gt(0)]
NonNegative = Annotated[float, Ge(0)]
#: a part of a whole that is neither nothing nor all of it
Share = Annotated[float, Gt(0), Lt(1)]
Seed = Annotated[int, Ge(0), Lt(2**31)]
Count = Annotated[int, Ge(1)]
#: height or width of images, in pixels
ImageSide = Annotated[int, Ge(16), Le(4096)]
#: longer side of images for local features, in pixels
FeatureSide = Annotated[int, Ge(64), Le(4096)]
#: channels of a layer
Channels = Annotated[int, Ge(8), Le(4096), MultipleOf(8)]

Made = TypeVar("Made", bound=Callable[..., Any])
#: bound -> its wording
WORDS = {
    Gt: "above {}",
    Ge: "at least {}",
    Lt: "below {}",
    Le: "at most {}",
    MultipleOf: "a multiple of {}",
    MinLen: "a list of at least {}",
}
#: what may hold ranges
SEVERAL = (Union, UnionType, tuple, list, Sequence)


def checked(make: Made) -> Made:
    """Check the arguments of a class or function against its annotations at each call.

    A subclass with a constructor of its own is checked if it is decorated too, or calls this one.

    Raises:
        ArgumentError: at the call, if a value is outside the range of its annotation. It names the argument, its value,
            what is allowed and, where there is one, the default.

    Example:
        >>> @checked
        ... def loss(margin: Positive = 0.5) -> float:
        ...     return margin
        >>> try:
        ...     loss(margin=-1)
        ... except ArgumentError as error:
        ...     print(error.problem, "|", error.fix)
        margin=-1 must be above 0 | For example margin=0.5
    """
    if isinstance(make, type):
        make.__init__ = checked(make.__init__)  # type: ignore[misc]
        return make

    @wraps(make)
    def call(*given: Any, **named: Any) -> Any:
        signature, known = ranges(make)
        try:
            values = signature.bind(*given, **named).arguments
        except TypeError:
            return make(*given, **named)  # Python says what is missing or unknown
        for name, parameter in known.items():
            if name in values and not fits(parameter.annotation, values[name]):
                problem = f"{name}={shown(values[name])} must be {requirement(parameter.annotation, values[name])}"
                raise ArgumentError(problem, _example(parameter), of=given[0] if "self" in values else None)
        return make(*given, **named)

    return call  # type: ignore[return-value]


@cache
def ranges(make: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, inspect.Parameter]]:
    """The signature of a class or function, and those of its parameters whose annotations are ranges."""
    signature = inspect.signature(make)
    return signature, {name: each for name, each in signature.parameters.items() if is_range(each.annotation)}


def is_range(kind: Any) -> bool:
    """Whether an annotation limits values beyond their type.

    Example:
        >>> is_range(float), is_range(Share), is_range(tuple[Count, Count] | None)
        (False, True, True)
    """
    if get_origin(kind) is Annotated:
        return bool(_bounds(kind)) or is_range(get_args(kind)[0])
    inner = [each for each in get_args(kind) if each is not ...]
    return get_origin(kind) is Literal or (get_origin(kind) in SEVERAL and any(map(is_range, inner)))


def fits(kind: Any, value: Any) -> bool:
    """Whether a value is within the range of an annotation. Arrays and tensors count as the numbers that they hold.

    Example:
        >>> fits(Share, 1.0), fits(Count | None, None), fits(tuple[Count, Count], (3, 4))
        (False, True, True)
    """
    origin, inner = get_origin(kind), get_args(kind)
    value = value.tolist() if hasattr(value, "tolist") else value
    if origin in (Union, UnionType):
        return any(fits(each, value) for each in inner)
    if origin is Annotated:
        return fits(inner[0], value) and all(_within(each, value) for each in _bounds(kind))
    if origin is Literal:
        return any(_is_a(type(each), value) and value == each for each in inner)
    if origin is not None and issubclass(origin, Sequence):
        many = isinstance(value, Sequence) and not isinstance(value, str)
        each = inner[:1] * len(value) if many and (origin is not tuple or inner[-1] is ...) else inner
        return many and len(each) == len(value) and all(map(fits, each, value))
    return _is_a(kind, value) and (kind is not float or isinstance(value, Integral) or math.isfinite(value))


def _is_a(kind: type, value: Any) -> bool:
    """Whether a value is of a type; a whole number counts as a number, true and false do not."""
    known = {int: Integral, float: Real}.get(kind, kind)
    return isinstance(value, known) and (kind not in (int, float) or not isinstance(value, bool))


def requirement(kind: Any, value: Any = None) -> str:
    """What a value must be, in words; the type of a number is left out if ``value`` is of that type.

    Example:
        >>> requirement(Share), requirement(Count, 0), requirement(Count | None, 0.5)
        ('a number above 0 and below 1', 'at least 1', 'a whole number, at least 1, or None')
        >>> requirement(Literal["l1", "l2"]), requirement(tuple[Positive, Positive])
        ('one of l1, l2', '2 values, each a number above 0')
    """
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return ", or ".join(requirement(each, value) for each in inner)
    if origin is Annotated:
        bounds = " and ".join(WORDS[type(each)].format(*astuple(each)) for each in _bounds(kind))
        of_type = fits(inner[0], value)
        if of_type or inner[0] not in (int, float):
            return bounds if of_type else requirement(inner[0])
        infinite = isinstance(value, float) and math.isinf(value)
        return f"a whole number, {bounds}" if inner[0] is int else f"a{' finite' * infinite} number {bounds}"
    if origin is Literal:
        return f"{'one of ' if len(inner) > 1 else ''}{', '.join(map(str, inner))}"
    if origin is not None and issubclass(origin, Sequence):
        fixed = origin is tuple and inner[-1] is not ...
        return f"{f'{len(inner)} values' if fixed else 'a list'}, each {requirement(inner[0])}"
    return {int: "a whole number", float: "a number", NoneType: "None", bool: "true or false", str: "a text"}[kind]


def _bounds(kind: Any) -> list[Any]:
    return [each for each in get_args(kind)[1:] if type(each) in WORDS]


def _within(bound: Any, value: Any) -> bool:
    holds = {Gt: operator.gt, Ge: operator.ge, Lt: operator.lt, Le: operator.le}
    if isinstance(bound, MultipleOf):
        return bool(value % bound.multiple_of == 0)
    if isinstance(bound, MinLen):
        return len(value) >= bound.min_length
    return bool(holds[type(bound)](value, *astuple(bound)))


def _example(parameter: inspect.Parameter) -> str | None:
    default = parameter.default
    return None if default in (parameter.empty, None) else f"For example {parameter.name}={default}"
