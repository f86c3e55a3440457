"""Tables of parts and options, made from the config files and their schemas.

``python docs/option_tables.py`` writes the short tables into the chapter guides; as a hook of the site this module
adds a page of options for each task, with every key of every part.
"""

import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_args

import yaml
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from pydantic import TypeAdapter

from sextant.chapters.calibration.config import Panoramas
from sextant.chapters.localization.config import Drives
from sextant.chapters.places.config import Nordland, Places
from sextant.config.schema.images import LabelledImages
from sextant.config.schema.parts import CustomPart, Node, Part, parts_of
from sextant.config.schema.run import Config
from sextant.config.schema.world_datasets import OfficeWalk, TownCity, TownFactors, TownSeasons
from sextant.registry import CHAPTERS

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- options -->", "<!-- /options -->"
#: the guide of each task
GUIDES = {
    "calibration": "calibration.md",
    "place_recognition": "places.md",
    "localization": "localization.md",
    "cosfire": "cosfire.md",
    "classification": "push_pull.md",
}
#: what each task learns from
DATA: dict[str, tuple[type[Part], ...]] = {
    "calibration": (Panoramas,),
    "place_recognition": (Places, TownSeasons, TownFactors, TownCity),
    "localization": (Drives, OfficeWalk, TownSeasons, TownCity, Nordland),
    "cosfire": (LabelledImages, Places, TownSeasons, TownFactors, TownCity),
    "classification": (LabelledImages,),
}
#: datasets of other tasks that also have drives, if their tables have headings
DRIVES = {"localization": ("place_folders",)}
#: groups whose files are named otherwise than the key of the config
GROUPS = {"test_sampling": "sampling"}
#: groups that several tasks share: listed in the guide of classification, and in the page of options of each
SHARED = ("backbone", "inhibition", "augmentation")
#: groups of one file, whose keys are listed beside those of the task
SINGLE = ("filter", "filters")
#: JSON schema's types in words
NUMBERS = {"integer": "whole number", "number": "number"}
OTHERS = {"null": "`null`", "boolean": "`true`, `false`", "string": "text", "object": "keys of its own"}
COMMENTED = re.compile(r"^(?P<indent> *)(?P<key>\w+): ?(?P<value>.*?)(?:\s+# (?P<comment>.*))?$")
ABOVE = re.compile(r"^ +# (?P<comment>.*)$")


def short_tables(task: str) -> str:
    """The groups of a task with their options, and the keys of the task, as Markdown."""
    config, defaults = _config(task), _defaults(task)
    groups = [name for name in _groups(config) if task == "classification" or name not in SHARED]
    rows = [f"| `{group}` | {_choices(task, group, defaults.get(group))} |" for group in groups]
    parts = "\n".join(["| group | options (default in bold) |", "|---|---|", *rows])
    keys = [*_keys("task", ROOT / "conf" / "task" / f"{task}.yaml", _node(config, "task"))]
    for group in (name for name in SINGLE if name in config.model_fields):
        keys += _keys(group, ROOT / "conf" / group / f"{defaults[group]}.yaml", _node(config, group))
    return f"{parts}\n\n{_table([row for row in keys if row[1] != row[2]])}"  # those with a choice


def page(task: str) -> str:
    """The page of options of a task: what each option of each group is, and its keys."""
    config = _config(task)
    sections = [f"# Options of `task={task}`", "## `task`"]
    sections.append(_table([*_keys("task", ROOT / "conf" / "task" / f"{task}.yaml", _node(config, "task"))]))
    for group in _groups(config):
        sections.append(f"## `{group}`")
        for path in _options(task, group):
            sections.append(f"**`{group}={path.stem}`** {_first_comment(path)}".rstrip())
            part = _part(path)
            if part is not None and (keys := [*_keys(group, path, part)]):
                sections.append(_table(keys))
    return "\n\n".join(sections) + "\n"


def filled(task: str, text: str) -> str:
    """The text of a guide with its tables renewed."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{short_tables(task)}\n\n{END}{after}"


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the pages into the navigation."""
    assert config.nav is not None
    config.nav.append({"Options": [{task.replace("_", " "): f"options/{task}.md"} for task in GUIDES]})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each task."""
    for task in GUIDES:
        files.append(File.generated(config, f"options/{task}.md", content=page(task)))
    return files


@cache
def _config(task: str) -> type[Config]:
    configs = {name: import_module(f"{package}.config").CONFIG for name, package in CHAPTERS.items()}
    return configs[task]  # all are imported, as parts of one chapter are options of another


def _groups(config: type[Config]) -> list[str]:
    """The groups that a task has and others have not."""
    own = [name for name in config.model_fields if name not in Config.model_fields or name == "dataset"]
    return [name for name in own if _files(name)]


def _files(group: str) -> list[Path]:
    return sorted((ROOT / "conf" / GROUPS.get(group, group)).glob("*.yaml"))


def _options(task: str, group: str) -> list[Path]:
    """The files of a group that the task takes."""
    kinds = DATA[task] if group == "dataset" else _kinds(_config(task).model_fields[group].annotation)
    taken = {part for kind in kinds for part in parts_of(kind)}
    more = DRIVES.get(task, ()) if group == "dataset" else ()
    return [path for path in _files(group) if not taken or _part(path) in (*taken, None) or path.stem in more]


def _kinds(annotation: Any) -> tuple[type[Part], ...]:
    """The base classes of parts that an annotation names."""
    if isinstance(annotation, type):
        return (annotation,) if issubclass(annotation, Part) and annotation is not CustomPart else ()
    return tuple(kind for inner in get_args(annotation) for kind in _kinds(inner))


def _choices(task: str, group: str, default: str | None) -> str:
    names = [path.stem for path in _options(task, group)]
    return ", ".join(f"**`{name}`**" if name == default else f"`{name}`" for name in names)


def _defaults(task: str) -> dict[str, str]:
    lines = (ROOT / "conf" / "task" / f"{task}.yaml").read_text("utf-8")
    return dict(re.findall(r"- override /(\w+): (\w+)", lines))


def _node(config: type[Config], key: str) -> type[Node]:
    annotation = config.model_fields[key].annotation
    assert isinstance(annotation, type)
    return annotation


def _part(path: Path) -> type[Part] | None:
    """The schema of an option, by its import path."""
    values = yaml.safe_load(path.read_text("utf-8")) or {}
    if "_target_" not in values:
        first = [name for name in values.get("defaults", []) if name != "_self_"]
        return _part(path.with_name(f"{first[0]}.yaml")) if first and isinstance(first[0], str) else None
    return _schemas().get(values["_target_"])


@cache
def _schemas() -> dict[str, type[Part]]:
    found, left = dict[str, type[Part]](), [Part]
    while left:
        part = left.pop()
        left += part.__subclasses__()
        for target in TypeAdapter(part.model_fields["target"].annotation).json_schema().get("enum", []) or [
            TypeAdapter(part.model_fields["target"].annotation).json_schema().get("const")
        ]:
            found[str(target)] = part
    return found


def _keys(prefix: str, path: Path, node: type[Node]) -> Iterator[tuple[str, str, str, str]]:
    """Key, default, what is allowed, and meaning, as the file and the schema have them."""
    values = yaml.safe_load(path.read_text("utf-8")) or {}
    comments = _comments(path)
    inner = f"{prefix}." if prefix == "task" and "task" in values else ""
    for name, value in (values.get("task", {}) if inner else values).items():
        if name in ("name", "defaults", "_target_", "_partial_") or name not in node.model_fields:
            continue
        meaning = comments.get(f"{inner}{name}", "")
        yield f"{prefix}.{name}", _shown(value), _allowed(node, name), meaning[:1].upper() + meaning[1:]


def _comments(path: Path) -> dict[str, str]:
    """The comment beside or above each key, with the lines that it runs on for; nested keys are dotted."""
    found, parents, last, column, waiting = dict[str, str](), list[tuple[int, str]](), "", -1, ""
    for line in path.read_text("utf-8").splitlines():
        if comment := ABOVE.match(line):
            if line.index("#") == column:
                found[last] += f" {comment['comment']}"
            else:
                waiting = f"{waiting} {comment['comment']}".strip()
        elif entry := COMMENTED.match(line):
            depth = len(entry["indent"])
            parents = [(indent, key) for indent, key in parents if indent < depth]
            last = ".".join([*(key for _, key in parents), entry["key"]])
            parents.append((depth, entry["key"]))
            found[last], waiting = f"{waiting} {entry['comment'] or ''}".strip(), ""
            column = entry.start("comment") - 2 if entry["comment"] else -1
    return found


def _first_comment(path: Path) -> str:
    lines = [line[2:] for line in path.read_text("utf-8").splitlines() if line.startswith("# ")]
    return " ".join(line for line in lines if not line.startswith("@package"))


def _allowed(node: type[Node], name: str) -> str:
    field = node.model_fields[name]
    annotation = field.annotation
    if _is_node(annotation):
        return "keys of its own"
    try:
        schema = node.model_json_schema(by_alias=False)
    except Exception:  # a part within it that is chosen by its target
        return ""
    return _range(schema["properties"][name], schema.get("$defs", {}))


def _is_node(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, Node)


def _range(schema: dict[str, Any], definitions: dict[str, Any]) -> str:
    """What a JSON schema allows, in words."""
    if "$ref" in schema:
        return "keys of its own"
    if "anyOf" in schema:
        return " or ".join(dict.fromkeys(filter(None, (_range(each, definitions) for each in schema["anyOf"]))))
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    kind = schema.get("type", "")
    if kind == "array":
        return f"list of {_range(schema.get('items', {}), definitions)}".removesuffix(" of ")
    return _interval(schema, NUMBERS[kind]) if kind in NUMBERS else OTHERS.get(kind, "")


def _interval(schema: dict[str, Any], kind: str) -> str:
    low = [f">= {schema['minimum']:g}"] if "minimum" in schema else []
    low += [f"> {schema['exclusiveMinimum']:g}"] if "exclusiveMinimum" in schema else []
    high = [f"<= {schema['maximum']:g}"] if schema.get("maximum", 2**31) < 2**31 else []
    high += [f"< {schema['exclusiveMaximum']:g}"] if schema.get("exclusiveMaximum", 2**31) < 2**31 else []
    return " and ".join([*low, *high]) or kind


def _shown(value: Any) -> str:
    text = yaml.safe_dump(value, default_flow_style=True, width=1000).strip()
    return f"`{text.removesuffix('...').strip()}`"


def _table(rows: list[tuple[str, str, str, str]]) -> str:
    lines = [f"| `{key}` | {default} | {allowed} | {meaning} |" for key, default, allowed, meaning in rows]
    return "\n".join(["| key | default | allowed | meaning |", "|---|---|---|---|", *lines])


if __name__ == "__main__":
    for task, name in GUIDES.items():
        guide = ROOT / "docs" / name
        guide.write_text(filled(task, guide.read_text("utf-8")), "utf-8")
