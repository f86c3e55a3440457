"""From a composed config to a typed one, with helpful errors."""

import difflib
import re
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from types import UnionType
from typing import Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from sextant.config.schema import Config
from sextant.config.schema.parts import Part, parts_of
from sextant.errors import UserError
from sextant.registry import CHAPTERS


def validate(config: Mapping[str, Any]) -> Config:
    """Check types, ranges, unknown keys and rules across keys.

    Returns:
        The config of the chapter that ``task.name`` names.

    Raises:
        UserError: the config is invalid. The message lists every problem with its key, its value, what is allowed, and
            an override to paste.
    """
    kind = config_class(config)
    try:
        return kind.model_validate(config)
    except ValidationError as error:
        problems = [dict(problem) for problem in error.errors()]
        told = [_explain(problem, config, kind) for problem in _joined(problems, config, kind)]
        raise UserError("\n".join(told)) from None


def config_class(config: Mapping[str, Any]) -> type[Config]:
    """The class of a config, by its ``task.name``.

    Raises:
        UserError: there is no such task.
    """
    kinds, task = config_classes(), config.get("task")
    name = task.get("name") if isinstance(task, Mapping) else None
    if not isinstance(name, str) or name not in kinds:
        given = "task is missing" if task is None else f"task.name={name}: no such task"
        if not isinstance(task, Mapping | type(None)):
            given = f"task={_shown(task)}: must hold keys, not one value"
        raise UserError(given, f"Choose one of {', '.join(f'task={each}' for each in kinds)}.")
    return kinds[name]


@cache
def config_classes() -> dict[str, type[Config]]:
    """The classes of the configs of all chapters. Any data set may be used in any of them."""
    kinds = {task: import_module(f"{package}.config").CONFIG for task, package in CHAPTERS.items()}
    for kind in kinds.values():
        if kind.__pydantic_complete__:  # used by itself, before all data sets were known
            kind.model_rebuild(force=True)
    return kinds


def nearest(word: str, candidates: Iterable[str]) -> str | None:
    """The candidate most similar to ``word``, None if none is close."""
    found = difflib.get_close_matches(word, list(candidates), n=1, cutoff=0.5)
    return found[0] if found else None


def _joined(problems: list[dict[str, Any]], config: Mapping[str, Any], kind: type[Config]) -> list[dict[str, Any]]:
    """The problems, with those of a value that matches none of several kinds joined into one."""
    kept: dict[Any, dict[str, Any]] = {}
    for number, problem in enumerate(problems):
        first = kept.setdefault(_locate(problem["loc"], config, kind)[0] if _simple(problem) else number, problem)
        if first is not problem:
            first["msg"] += f", or {_said(problem).removeprefix('must be ')}"
    return list(kept.values())


def _simple(problem: Mapping[str, Any]) -> bool:
    return problem["type"] not in ("extra_forbidden", "missing", "value_error", "model_type")


def _said(problem: Mapping[str, Any]) -> str:
    message: str = problem["msg"]
    return message.removeprefix("Input ").removeprefix("String ").replace("should ", "must ")


def _explain(problem: dict[str, Any], config: Mapping[str, Any], kind: type[Config]) -> str:
    key, parent, field = _locate(problem["loc"], config, kind)
    value = problem["input"]
    if parent is kind and problem["type"] in ("extra_forbidden", "missing") and (tasks := _tasks_with(key)):
        needs = f"{key} is missing: task={config['task']['name']} needs one"
        belongs = f"{key} belongs to task={' or '.join(tasks)}; leave it out, or choose that task"
        return needs if problem["type"] == "missing" else belongs
    if problem["type"] == "extra_forbidden":
        names = _names(parent)
        near = nearest(key.rsplit(".", 1)[-1], names)
        prefix = key.rsplit(".", 1)[0] + "." if "." in key else ""
        hint = f"Did you mean {prefix}{near}={value}?" if near else f"Keys there: {', '.join(names) or 'none'}"
        return f"{key}: unknown key. {hint}"
    if problem["type"] == "missing":
        return f"{key} is missing. {_example(key, field)}".rstrip()
    if problem["type"] == "value_error":
        said = str(problem["ctx"]["error"])
        return said if isinstance(value, Mapping | BaseModel) else f"{key}: {said}"  # rules across keys name them
    if problem["type"] == "model_type":
        return f"{key}={_shown(value)}: must hold keys, not one value"
    return f"{key}={_shown(value)}: {_said(problem)}. {_example(key, field)}".rstrip()


def _tasks_with(group: str) -> list[str]:
    """The tasks that have a group; none if it is not a group, or common to all tasks."""
    own = group not in Config.model_fields
    return [task for task, kind in config_classes().items() if own and group in kind.model_fields]


def _shown(value: Any) -> str:
    return (
        repr(value)
        if isinstance(value, str | dict | list)
        else str(value).lower()
        if isinstance(value, bool)
        else str(value)
    )


def _example(key: str, field: FieldInfo | None) -> str:
    whole = re.sub(r"(\.\d+)+$", "", key)  # examples are for the list, not for one entry
    return f"For example {whole}={field.examples[0]}" if field is not None and field.examples else ""


def _names(model: type[BaseModel]) -> list[str]:
    names = (field.alias or name for name, field in model.model_fields.items())
    return [name for name in names if not name.startswith("_")]


def _locate(
    loc: tuple[str | int, ...], config: Mapping[str, Any], kind: type[Config]
) -> tuple[str, type[BaseModel], FieldInfo | None]:
    """The dotted key of an error without tags of unions, the model that holds it, and its field."""
    parent: type[BaseModel] = kind
    field: FieldInfo | None = None
    options: list[Any] = [kind]
    keys: list[str] = []
    value: Any = config
    for part in loc:
        inside = isinstance(value, Mapping) and (part in value or any(map(_is_model, options)))
        if isinstance(part, str) and not inside:
            break  # what follows the last key names the kinds that its value may be of
        is_key = (isinstance(value, Mapping) and part in value) or isinstance(part, int) or not _is_tag(part, options)
        if not is_key:
            options = [option for option in options if _is_tag(part, [option])]
            continue
        keys.append(str(part))
        model = next(filter(_is_model, options), None)
        if model is not None:
            parent = model
            found = {f.alias or name: f for name, f in model.model_fields.items()}.get(str(part))
            field = found or (field if isinstance(part, int) else None)
            options = _options(found.annotation) if found else []
        else:
            options = [inner for option in options for inner in _options((get_args(option) or (None,))[-1])]
        value = _inside(value, part)
    return ".".join(keys), parent, field


def _inside(value: Any, part: str | int) -> Any:
    if isinstance(value, Mapping):
        return value.get(part)
    return value[part] if isinstance(value, list) and isinstance(part, int) and part < len(value) else None


def _options(annotation: Any) -> list[Any]:
    if get_origin(annotation) in (Union, UnionType):
        return [inner for option in get_args(annotation) for inner in _options(option)]
    if hasattr(annotation, "__metadata__"):
        return _options(annotation.__origin__)
    return parts_of(annotation) if isinstance(annotation, type) and issubclass(annotation, Part) else [annotation]


def _is_model(option: Any) -> bool:
    return isinstance(option, type) and issubclass(option, BaseModel)


def _is_tag(part: str | int, options: Iterable[Any]) -> bool:
    for option in options:
        if not _is_model(option):
            continue
        if "target" in option.model_fields:
            literal = get_args(option.model_fields["target"].annotation)
            if part in literal or (part == "custom" and not literal):
                return True
        elif any(  # tags of a task or a launcher
            name in option.model_fields and part in get_args(option.model_fields[name].annotation)
            for name in ("name", "kind")
        ):
            return True
    return False
