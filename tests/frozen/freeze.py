"""What must stay as it is while files move: ``python tests/frozen/freeze.py`` writes it anew, wholly or by part.

``configs.json.gz`` has the composed config of every option, experiment and arm of a sweep, and its digest;
``wrong.json.gz`` one wrong value for each key; ``names.json`` what can be imported, and the classes that a config may
name; ``ranges.json`` what the arguments of checked classes and functions must be; ``help.json`` what ``--help`` prints.
``runs/`` is written by ``freeze_runs.py``.

A difference is a fault of the change, unless the change is meant: then write the part anew, in a commit that says why.
"""

import contextlib
import gzip
import importlib
import io
import json
import pkgutil
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
from needed import CHOICES, words

import sextant
from sextant import cli
from sextant.composing.compose import compose, composing_many, to_plain
from sextant.composing.config_files import groups
from sextant.config import digest, validate
from sextant.errors import UserError
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.sweep_plan import cell_config, read_design
from sextant.moved import with_first_names
from sextant.ranges import checked, ranges, requirement

HERE = Path(__file__).parent
#: folders that no machine has, in place of its own
FOLDERS = ("paths.data=/data", "paths.outputs=/outputs", "paths.cache=/cache")
#: values of which at least one is wrong for any key whose range is checked, in the order in which they are tried
WRONG = ("no such value", -7, 1e30, [], [{}], {"no such key": 1}, None)


def read(name: str) -> Any:
    """What was frozen."""
    raw = (HERE / name).read_bytes()
    return json.loads(gzip.decompress(raw) if name.endswith(".gz") else raw)


def write(name: str, content: Any) -> None:
    text = json.dumps(content, sort_keys=True, indent=None if name.endswith(".gz") else 1).encode()
    (HERE / name).write_bytes(gzip.compress(text, mtime=0) if name.endswith(".gz") else text + b"\n")


def choices() -> Iterator[tuple[str, list[str]]]:
    """Each option of each group with what it needs beside it, by a name."""
    for group, option in CHOICES:
        if group != "sweep":
            yield f"{group}={option}", [*words(group, option), *FOLDERS]


def cells() -> Iterator[tuple[str, dict[str, Any]]]:
    """Configs that together hold each arm and each value of a sweep, by a name; of a search, its usual config."""
    for option in groups()["sweep"]:
        chosen = [*words("sweep", option), *FOLDERS]
        if option.startswith("search_"):
            yield f"sweep={option}", read_search(chosen)[1].plain
            continue
        design = read_design(chosen)
        arms = list(design.arms)
        for number in range(max(len(arms), *map(len, design.factors.values()), 1)):
            setting = {key: values[number % len(values)] for key, values in design.factors.items()}
            arm = arms[number % len(arms)]
            name = " ".join([f"sweep={option}", *(f"{key}={value}" for key, value in setting.items()), arm])
            yield name, cell_config(design, setting, arm)[1].plain


def configs() -> dict[str, dict[str, Any]]:
    """Digest and config by name, without the paths of this machine."""
    with composing_many():
        composed = [(name, to_plain(compose(words))) for name, words in choices()]
        return {name: of_config(plain) for name, plain in [*composed, *cells()]}


def kept(plain: dict[str, Any]) -> dict[str, Any]:
    """A config by first names, without what differs between machines."""
    return with_first_names({key: value for key, value in plain.items() if key not in ("paths", "hydra")})


def of_config(plain: dict[str, Any]) -> dict[str, Any]:
    """Digest and config."""
    return {"digest": digest(validate(plain).model_dump(by_alias=True)), "config": kept(plain)}


def keys(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The paths of all keys within a config."""
    for key, value in node.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from keys(value, (*path, key))


def refuses(plain: dict[str, Any], path: tuple[str, ...], value: Any) -> bool:
    """Whether a config is refused with this value of a key."""
    changed = json.loads(json.dumps(plain))
    node = changed
    for key in path[:-1]:
        node = node[key]
    node[path[-1]] = value
    try:
        validate(changed)
    except UserError:
        return True
    return False


def paths() -> dict[str, Any]:
    """What a config says of its folders, which is not frozen."""
    return {"paths": to_plain(compose(list(FOLDERS)))["paths"]}


def wrong_values() -> dict[str, int | None]:
    """For each key of each option, and of each task, the first wrong value that is refused."""
    found: dict[str, int | None] = {}
    with composing_many():
        for name, words in choices():
            group, plain = name.partition("=")[0], to_plain(compose(words))
            for path in keys(plain):
                if path[0] not in ("hydra", "paths", "sweep") and (path[0] == group or group == "task"):
                    found[f"{name} {'.'.join(path)}"] = next(
                        (k for k, value in enumerate(WRONG) if refuses(plain, path, value)), None
                    )
    return found


def names() -> dict[str, Any]:
    """Public names of the package and its subpackages, and the classes that a config may name."""
    public = {"sextant": sorted(each for each in dir(sextant) if not each.startswith("_"))}
    for module in pkgutil.walk_packages(sextant.__path__, "sextant."):
        if module.ispkg and (found := getattr(importlib.import_module(module.name), "__all__", None)):
            public[module.name] = sorted(found)
    return {"public": public, "targets": sorted(targets())}


def targets() -> set[str]:
    """Every ``_target_`` of a frozen config."""
    found: set[str] = set()

    def within(node: Any) -> None:
        if isinstance(node, dict):
            if isinstance(node.get("_target_"), str):
                found.add(node["_target_"])
            for value in node.values():
                within(value)
        elif isinstance(node, list):
            for value in node:
                within(value)

    for entry in read("configs.json.gz").values():
        within(entry["config"])
    return found


def helps() -> dict[str, str]:
    """What each verb prints when asked for help."""
    found = {}
    for verb in ["", *cli.VERBS]:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            cli.run(*((verb, ["--help"]) if verb else ("--help", [])))
        found[verb or "sextant"] = printed.getvalue()
    return found


@cache
def checked_calls() -> dict[str, Callable[..., Any]]:
    """Each class, method and function that checks its arguments, by its name within its module."""
    source, code, found = Path(sextant.__file__).parent, checked(print).__code__, []
    for path in sorted(path for path in source.rglob("*.py") if "@checked" in path.read_text()):
        module = importlib.import_module(".".join(path.relative_to(source.parent).with_suffix("").parts))
        own = [each for each in vars(module).values() if getattr(each, "__module__", None) == module.__name__]
        members = [each for kind in own if isinstance(kind, type) for each in vars(kind).values()]
        found += [each for each in (*own, *members) if getattr(each, "__code__", None) is code]
    named = {call.__qualname__.removesuffix(".__init__"): call for call in found}
    assert len(named) == len(set(found)), "two checked classes have one name"
    return named


def allowed() -> dict[str, dict[str, str]]:
    """What each argument of a checked call must be, by the call's name; of a list also how few values are enough."""
    return {
        name: {
            argument: "; ".join(dict.fromkeys(requirement(each.annotation, given) for given in (None, ())))
            for argument, each in ranges(call.__wrapped__)[1].items()
        }
        for name, call in checked_calls().items()
    }


PARTS = {
    "configs.json.gz": configs, "wrong.json.gz": wrong_values, "names.json": names, "ranges.json": allowed,
    "help.json": helps,
}  # fmt: skip

if __name__ == "__main__":
    for name in sys.argv[1:] or PARTS:
        write(name, PARTS[name]())
        print(f"{(HERE / name).stat().st_size:>8} {name}")
