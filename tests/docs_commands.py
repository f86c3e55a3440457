"""The commands that README, docs and the cards of the zoo tell, and whether each would be understood."""

import ast
import re
import shlex
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from sextant import cli
from sextant.chapters.calibration.options import CalibrationOptions
from sextant.chapters.cosfire.options import DetectionOptions
from sextant.cli import (
    benchmark,
    claims,
    corruptions_make,
    dashboard,
    data,
    demo,
    gallery,
    inspect,
    localize,
    locate,
    predict,
    replay,
    report,
    train,
    trajectory,
    walk,
)
from sextant.cli.data_describe import DescribeOptions
from sextant.cli.evaluate import split_run
from sextant.composing.compose import compose, to_plain
from sextant.composing.config_files import groups
from sextant.console.arguments import parse_arguments
from sextant.errors import UserError
from sextant.lifecycle.checks import checked
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.evaluation import checkpoint_config, require_foreign_overrides
from sextant.lifecycle.search.design import read_search
from sextant.lifecycle.sweep_plan import cell_config, read_design, sweep_words
from sextant.models.foreign_classifier import SOURCES
from sextant.registry import chapter_of
from sextant.reports.stored_cells import is_stored
from sextant.zoo import PREFIX, model_file, names, read_card

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *(page for folder in ("docs", "docs/tutorials", "results") for page in sorted((ROOT / folder).glob("*.md"))),
]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
INLINE = re.compile(r"`((?:python|sextant|make) [^`]+)`")
PLACEHOLDER = re.compile(r"<[^<>]*>")
#: what stands for a placeholder such as ``<run>``
SOMETHING = "something"
#: what a trained model of a page is of, where it is not a classifier of digits
MODELS = {
    "calibration.md": ("task=calibration",),
    "photos.md": ("task=calibration",),
    "places.md": ("task=place_recognition",),
    "corruptions.md": ("dataset=cifar10", "backbone=resnet20"),
    "push_pull.md": ("dataset=cifar10", "backbone=resnet20"),
    "models.md": ("task=localization",),
}


@dataclass(frozen=True)
class Command:
    """A command of a page, as it is written there."""

    page: str
    text: str

    @property
    def words(self) -> list[str]:
        """What a shell would make of it, with something in place of each placeholder."""
        return shlex.split(PLACEHOLDER.sub(SOMETHING, self.text))

    def __str__(self) -> str:
        return self.text


def commands_of(page: str, text: str) -> list[Command]:
    """Every line of the ``bash`` blocks of a page, and all inline code that begins with a program of ours."""
    blocks = [body.replace("\\\n", " ") for kind, body in FENCED.findall(text) if kind == "bash"]
    lines = [re.sub(r"(^|\s+)#\s.*", "", line) for body in blocks for line in body.splitlines()]
    found = [" ".join(command.split()) for command in [*lines, *INLINE.findall(FENCED.sub("", text))]]
    return [Command(page, command) for command in dict.fromkeys(found) if command]


def commands_of_card(name: str) -> list[Command]:
    """How a model of the zoo was trained, and what measures it."""
    card = read_card(model_file(f"zoo:{name}"))
    trained = card["command"] if isinstance(card["command"], list) else [card["command"]]
    return [Command(f"{name}.json", text) for text in [*trained, card["metrics"]["command"]]]


def documented() -> list[Command]:
    """The commands of all pages and cards; one that several tell counts for the first."""
    found = [command for page in PAGES for command in commands_of(page.name, page.read_text())]
    found += [command for name in names() for command in commands_of_card(name)]
    return list({command.text: command for command in reversed(found)}.values())[::-1]


def check(command: Command) -> None:
    """Raise a ``UserError`` unless the command is one that could be run, its data and its trained models apart."""
    program, *words = command.words
    program = program.removeprefix(".venv/bin/")
    if program == "python" and words[0] != "-m":
        program, words = "sextant", [words[0].removesuffix(".py"), *words[1:]]
    words = [each for word in words for each in cli.spelled_out(word)]
    if program == "python":
        _module(words[1], words[2:])
    elif program == "make":
        targets = re.findall(r"^([a-z-]+):.*##", (ROOT / "Makefile").read_text(), re.MULTILINE)
        _among("make", words[0], targets)
    elif program == "sextant":
        _among("sextant", words[0], cli.VERBS)
        if "--help" not in words:
            VERBS.get(words[0], _nothing)(command, words[1:])
    else:
        _among("command", command.text, ["source .venv/bin/activate"])


def _train(command: Command, words: list[str]) -> None:
    flags = ("-m", train.DRY_RUN) if "-m" in words else ()
    overrides = [word for word in words if word not in flags and not word.startswith("--config-dir=")]
    if "-m" not in words:
        _among(command.text, "without -m", ["without -m"] if not any(w.startswith("sweep=") for w in words) else [])
        checked(to_plain(compose(overrides)))
        return
    overrides = sweep_words(overrides)
    if read_search(overrides) is not None:  # and the middle and the ends of its space are right
        return
    design = read_design(overrides)
    setting = {key: values[0] for key, values in design.factors.items()}
    stored = any(word.startswith("sweep=") for word in words)  # all of its arms are tested with the config
    for arm in list(design.arms)[: 1 if stored else None]:
        cell_config(design, setting, arm, design.worlds[0])


def _evaluate(command: Command, words: list[str]) -> None:
    if words[0].startswith("model="):
        assert words[0].removeprefix("model=").startswith(SOURCES)
        require_foreign_overrides(words[1:])
        checked(to_plain(compose(["task=classification", *words[1:]])))
        return
    run, overrides = split_run(words, command.text)
    shipped = [f"{PREFIX}{name}" for name in names()]
    raw = read_card(model_file(run))["model"]["config"] if run in shipped else _model(MODELS.get(command.page, ()))
    task = raw["task"]["name"]
    config = checkpoint_config({"config": raw, "task": task, "spec": {}}, overrides)
    chapter_of(task).check_parts(config)


@cache
def _model(choices: tuple[str, ...]) -> dict:
    return to_plain(compose(choices))


def _predict(command: Command, words: list[str]) -> None:
    given = parse_arguments(words, predict.KEYS, command.text)
    needed = ["run", "input", "output"] if "run" in given else ["input"]
    if "task" in given:
        needed = ["prototype", "input", "output"]
        DetectionOptions.of(given)
    elif "map" in given:
        needed = ["run", "map", "queries"]
    elif "odometry" in given:
        needed = ["run", "input", "odometry"]
    else:
        CalibrationOptions.of(given)
    for key in needed:
        _among(f"{key}= of", command.text, [command.text] if key in given else [])


def _report(command: Command, words: list[str]) -> None:
    given = parse_arguments(words, report.ReportOptions.meanings(), command.text)
    if not all(is_stored(ROOT / folder) for folder in given["sweep"].split(",")):
        _among("sweep", given["sweep"], [*groups()["sweep"], "search", SOMETHING])


def _claims(command: Command, words: list[str]) -> None:
    words = words[1:] if words[:1] == ["plan"] else words
    given = parse_arguments(words, claims.ClaimsOptions.meanings(), command.text)
    read_claims(given.get("claim", "all"))


def _data(command: Command, words: list[str]) -> None:
    verb, *rest = words
    _among("sextant data", verb, ["list", "render", "describe", "verify", "gallery", "posed"])
    if verb == "render":
        _, overrides = data.render_options(rest)
        checked(to_plain(compose(overrides)))
    elif verb == "describe":
        DescribeOptions.of(parse_arguments(rest, DescribeOptions.meanings(), command.text), command.text)
    elif verb in ("gallery", "posed"):
        options = gallery.GalleryOptions if verb == "gallery" else data.PosedOptions
        parse_arguments(rest, options.meanings(), command.text)


def _runs(command: Command, words: list[str]) -> None:
    _among("sextant runs", words[0] if words else "list", ["list", "delete"])


def _sweep(command: Command, words: list[str]) -> None:
    _among("sextant sweep", words[0], ["status", "attach", "cancel"])
    _among("sextant sweep", words[1], [*groups()["sweep"], SOMETHING])


def _doctor(command: Command, words: list[str]) -> None:
    _among("sextant doctor", " ".join(words), ["", "calibration"])


def _compare(command: Command, words: list[str]) -> None:
    _among(command.text, "two runs", ["two runs"] if sum(word.startswith("run=") for word in words) == 2 else [])


def _trajectory(command: Command, words: list[str]) -> None:
    files = [word for word in words if "=" not in word]
    _among(command.text, f"{len(files)} files", ["2 files"])
    trajectory.TrajectoryOptions.parse([word for word in words if word not in files], command.text)


def _benchmark(command: Command, words: list[str]) -> None:
    _among("sextant benchmark", words[0], ["calibration"])
    given = benchmark.BenchmarkOptions.parse(words[1:], command.text)
    _among("sampling", given.sampling, groups()["sampling"])


def _inspect(command: Command, words: list[str]) -> None:
    _among(command.text, "an input", ["an input"] if words and "=" not in words[0] else [])
    inspect.InspectOptions.parse([f"input={words[0]}", *words[1:]], command.text)


def _localize(command: Command, words: list[str]) -> None:
    localize.LocalizeOptions.parse([word for word in words if not word.startswith("odometry=")], command.text)


def _locate(command: Command, words: list[str]) -> None:
    locate.LocateOptions.parse(words, command.text)


def _walk(command: Command, words: list[str]) -> None:
    walk.WalkOptions.parse(words, command.text)


def _replay(command: Command, words: list[str]) -> None:
    replay.ReplayOptions.parse(words, command.text)


def _dashboard(command: Command, words: list[str]) -> None:
    parse_arguments(words, dashboard.DashboardOptions.meanings(), command.text)


def _demo(command: Command, words: list[str]) -> None:
    demo.DemoOptions.parse(words, command.text)


def _nothing(command: Command, words: list[str]) -> None:
    """Nothing to look at."""


VERBS = {
    "train": _train,
    "evaluate": _evaluate,
    "predict": _predict,
    "sweep": _sweep,
    "report": _report,
    "claims": _claims,
    "data": _data,
    "runs": _runs,
    "compare": _compare,
    "doctor": _doctor,
    "trajectory": _trajectory,
    "benchmark": _benchmark,
    "inspect": _inspect,
    "locate": _locate,
    "walk": _walk,
    "localize": _localize,
    "replay": _replay,
    "dashboard": _dashboard,
    "demo": _demo,
}


def _module(module: str, words: list[str]) -> None:
    """``python -m``: the benchmarks, and corruptions as files."""
    if module == "sextant.corruptions":
        _among(module, words[0], ["make"])
        given = parse_arguments(words[1:], corruptions_make.MakeOptions.meanings(), module)
        _among("set", given["set"], ["cifar10_c", "cifar100_c", "mnist_c", "imagenet_c"])
        return
    package, _, name = module.partition(".")
    _among("python -m", package, ["benchmarks"])
    known = sorted(path.stem for path in (ROOT / "benchmarks").glob("*.py"))
    if name:
        _among(package, name, known)
        parse_arguments(words, dict.fromkeys(_keys(name), ""), module)
    else:
        for word in words:
            _among(package, word, known)


def _keys(benchmark: str) -> list[str]:
    """The keys of a benchmark, read from its source: importing it would import all that it compares."""
    source = (ROOT / "benchmarks" / f"{benchmark}.py").read_text()
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "KEYS":
            return [ast.literal_eval(key) for key in node.value.keys]
    return re.findall(r'removeprefix\("(\w+)="\)', source)


def _among(what: str, value: str, known) -> None:
    if value not in known:
        raise UserError(f"{what} {value}: no such thing", f"There are {', '.join(known) or 'none'}")
