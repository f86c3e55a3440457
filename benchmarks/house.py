"""Measures of the package's structure: files, folders of a chapter, imports, and packages that a commit touches.

``python -m benchmarks.house`` counts in the files, in a minute of one core. Files named ``__init__.py`` are left
out; a *package* is a folder in ``src/sextant``, or one chapter in ``src/sextant/chapters``.
"""

import ast
import os
import re
import statistics
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import grimp
import networkx

ROOT = Path(__file__).parents[1]
SRC = ROOT / "src" / "sextant"
SHORT = 60
COMMITS = 300
#: a commit of more files counts as a renaming or move
MOST_FILES = 40
#: words by which a path belongs to a chapter
CHAPTERS = {
    "calibration": ("calibration", "calibrator", "camera", "cameras"),
    "places": ("place", "places"),
    "localization": ("localization", "localizer", "localizing", "localize", "walks"),
    "cosfire": ("cosfire",),
}
TASKS = ("classification", "place_recognition", "localization", "calibration", "cosfire")
#: where a task is named on purpose
MAY_NAME_TASKS = ("chapters/", "config/schema/")
#: packages of today by how paths began before, for the history
MOVED = {
    **{
        f"{folder}/{words}": f"chapters/{chapter}"
        for chapter, names in {
            "classification": ("classification", "image_classification", "classifier"),
            "calibration": ("calibration", "photo_calibration", "camera_network"),
            "places": ("place", "descriptors", "off_the_shelf", "kept_descriptor", "backbone_layer"),
            "localization": ("localization", "localizing", "run_map"),
            "cosfire": ("cosfire", "detection"),
        }.items()
        for words in names
        for folder in ("tasks", "applications", "data", "figures", "recipes", "trained", "cli")
    },
    "evaluation/calibration": "chapters/calibration",
    **{f"applications/{tool}": "tools" for tool in ("walks", "inspection", "demonstration")},
    **{f"cli/{name}": "console" for name in ("arguments", "console", "output_folder", "skipped", "work_progress")},
    "cli/predict_handler": "kit",
    "tasks/": "training",
    "recipes/": "kit",
    "trained/": "kit",
}
TRAIN = """
import os, sys, tempfile
os.environ["SEXTANT_OUTPUTS"] = tempfile.mkdtemp()
from sextant.composing.compose import compose, to_plain
from sextant.config import validate
from sextant.registry import chapter_of
from sextant.kit.assemble import build_dataset
import sextant.lifecycle.execute, sextant.cli.train
config = validate(to_plain(compose(["task=calibration"])))
chapter_of("calibration")
build_dataset(config)
print(sum(name.split(".")[0] == "sextant" for name in sys.modules))
"""


def modules() -> list[Path]:
    """The files that are counted."""
    return [path for path in sorted(SRC.rglob("*.py")) if path.name != "__init__.py"]


def folders_of(words: tuple[str, ...]) -> set[Path]:
    """The folders of a chapter: topmost ones that have its name, and those of single modules that have it."""
    found = set()
    for path in modules():
        parts = path.relative_to(SRC).with_suffix("").parts
        named = [set(part.split("_")).intersection(words) for part in parts]
        if any(named):
            first = next(number for number, hit in enumerate(named) if hit)
            found.add(Path(*parts[: first + 1]) if first < len(parts) - 1 else Path(*parts[:-1]))
    return found


def package_of(path: str) -> str:
    """The package in which a file of the history lies today."""
    if before := max(filter(path.startswith, MOVED), key=len, default=None):
        return MOVED[before]
    parts = path.split("/")
    return "/".join(parts[:2]) if parts[0] == "chapters" else parts[0]


def replayed() -> list[int]:
    """How many packages each of the last commits touched that changed the package, by where files lie today."""
    log = ["git", "log", "--no-merges", "--format=%x00", "--name-only", "--", "src/sextant"]
    text = subprocess.run(log, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    found = []
    for commit in text.split("\0")[1:]:
        files = [line.removeprefix("src/sextant/") for line in commit.split() if line.endswith(".py")]
        inner = [file for file in files if "/" in file]
        if inner and len(files) <= MOST_FILES:
            found.append(len({package_of(file) for file in inner}))
    return found[:COMMITS]


def naming_tasks() -> list[str]:
    """The modules that compare with the name of a task, or look something up by it."""
    return [
        path.relative_to(SRC).as_posix()
        for path in modules()
        if not path.relative_to(SRC).as_posix().startswith(MAY_NAME_TASKS)
        and any(_names_tasks(node) for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    ]


def _names_tasks(node: ast.AST) -> bool:
    if isinstance(node, ast.Compare):
        operands: Iterator[ast.AST | None] = chain([node.left], node.comparators)
        tasks = [each for each in operands if _is_task(each)]
        return bool(tasks) and "task" in ast.unparse(node).replace("'", "")
    if isinstance(node, ast.Dict):
        return sum(_is_task(key) for key in node.keys) > 1
    return isinstance(node, ast.MatchValue) and _is_task(node.value)


def _is_task(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and node.value in TASKS


def circles() -> list[set[str]]:
    """Circles of imports, those through the ``__init__`` of packages included: importing a module runs these."""
    graph = grimp.build_graph("sextant", cache_dir=None)

    def packages(name: str) -> set[str]:
        parts = name.split(".")
        return {".".join(parts[:length]) for length in range(1, len(parts))}

    edges = [
        (name, run)
        for name in graph.modules
        for other in graph.find_modules_directly_imported_by(name)
        for run in {other, *(packages(other) - packages(name) - {name})}
    ]
    return [found for found in networkx.strongly_connected_components(networkx.DiGraph(edges)) if len(found) > 1]


def layers() -> int:
    """Layers of the contract."""
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = config["tool"]["importlinter"]["contracts"]
    return next(len(contract["layers"]) for contract in contracts if contract["type"] == "layers")


def loaded() -> int:
    """Modules of the package loaded by ``train task=calibration`` once its data set is built but not read."""
    done = subprocess.run([sys.executable, "-c", TRAIN], cwd=ROOT, capture_output=True, text=True, check=True)
    return int(done.stdout.split()[-1])


def cpu_of(*words: str, times: int = 3) -> float:
    """The least CPU time in seconds of ``times`` runs of a Python process."""
    found = []
    for _ in range(times):
        before = os.times()
        subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, check=True)
        after = os.times()
        found.append(after.children_user + after.children_system - before.children_user - before.children_system)
    return min(found)


def run() -> list[tuple[str, str, str, str, str]]:
    """Rows for the table of benchmarks."""
    lines = [len(path.read_text(encoding="utf-8").splitlines()) for path in modules()]
    touched, naming = replayed(), naming_tasks()
    hydra = cpu_of("-c", "import hydra")
    light = [cpu_of("train.py", *words) / hydra for words in (["--help"], ["--cfg", "job"])]
    short = sum(count < SHORT for count in lines) / len(lines)
    folders = "; ".join(str(len(folders_of(words))) for words in CHAPTERS.values())
    one = sum(count == 1 for count in touched) / len(touched)
    tests = sum(len(re.findall(r"^def test", path.read_text(), re.M)) for path in (ROOT / "tests").rglob("test_*.py"))
    mean = statistics.fmean(touched)
    facts = (
        (f"folders of {'; '.join(CHAPTERS)}", folders, "1 and its part of the library"),
        ("files; lines", f"{len(lines)}; {sum(lines):,}", "<= 520 files"),
        (f"files under {SHORT} lines; median", f"{short:.0%}; {statistics.median(lines):.0f}", "<= 15 %; >= 120"),
        (
            f"of {len(touched)} commits in one package; mean",
            f"{one:.0%}; {mean:.2f}",
            ">= 55 %; <= 2",
        ),
        ("modules that name tasks", str(len(naming)), "1"),
        ("modules loaded for task=calibration", str(loaded()), "<= 170"),
        ("layers; circles", f"{layers()}; {len(circles())}", "<= 9; 0"),
        ("--help; --cfg job, CPU time of import hydra", "; ".join(f"{ratio:.1f}x" for ratio in light), "<= 5x; <= 4x"),
        ("test functions", f"{tests:,}", ""),
    )
    return [(name, measured, "", "", aim) for name, measured, aim in facts]


if __name__ == "__main__":
    for name, measured, _, _, aim in run():
        print(f"{name:<60} {measured:<24} {aim}")
    print("\n".join(["", "modules that name tasks:", *(f"  {name}" for name in naming_tasks())]))
