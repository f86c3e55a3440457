"""``evaluate.py``: test a trained model on other data or under other corruptions."""

from collections.abc import Sequence

from sextant.cli.show import show_result
from sextant.cli.terminal import TERMINAL
from sextant.errors import UserError
from sextant.lifecycle.evaluation import FREE, evaluate_model, evaluate_run
from sextant.tracking.environment import quiet_libraries

USAGE = (
    "sextant evaluate run=<MLflow run id, run directory, checkpoint or published .pth.tar> "
    "[dataset=..] [corruption=..] [key=value ..]\n"
    "   or: sextant evaluate model=<timm:name or file, or robustbench:file> dataset=.. [corruption=..] [inhibition=..]"
)


def main(arguments: Sequence[str]) -> None:
    """Rebuild the model from its checkpoint alone, or read one of others, and test it."""
    quiet_libraries()
    if any(argument in ("-h", "--help") for argument in arguments):
        print(f"{USAGE}\n\n  what may change: {', '.join(FREE)}; for their keys, see train.py --cfg job")
        return
    models = [argument.removeprefix("model=") for argument in arguments if argument.startswith("model=")]
    if models:
        rest = [argument for argument in arguments if not argument.startswith("model=")]
        if len(models) > 1 or any(argument.startswith("run=") for argument in rest):
            raise UserError("model= must be given once and without run=", USAGE)
        show_result(evaluate_model(models[0], rest, TERMINAL))
        return
    run, overrides = split_run(arguments, USAGE)
    show_result(evaluate_run(run, overrides, TERMINAL))


def split_run(arguments: Sequence[str], usage: str) -> tuple[str, list[str]]:
    """Separate ``run=`` from the other arguments.

    Raises:
        UserError: ``run=`` is missing.
    """
    runs = [argument.removeprefix("run=") for argument in arguments if argument.startswith("run=")]
    if not runs:
        raise UserError("run= is missing", usage)
    return runs[-1], [argument for argument in arguments if not argument.startswith("run=")]
