"""The command line: ``sextant <verb>``, and ``train.py``, ``evaluate.py``, ``predict.py``, ``report.py`` beside it."""

import sys
import warnings
from importlib import import_module

import sextant
from sextant.cli.completing import complete, completes
from sextant.cli.streams import whole_streams
from sextant.errors import UserError, naming_extras

USAGE = "usage: sextant <verb> [key=value ...]"

#: verb -> module with a ``main(arguments)``, and what it does
VERBS = {
    "train": ("sextant.cli.train", "train and test a model, or sweep with -m"),
    "evaluate": ("sextant.cli.evaluate", "test a trained model, also on other data or under corruptions"),
    "predict": ("sextant.cli.predict", "classify, calibrate or localize images, recognize places, or detect a pattern"),
    "demo": ("sextant.cli.demo", "demonstrate Sextant in the browser on your own photos"),
    "inspect": ("sextant.cli.inspect", "summarize your photos, video or poses, and suggest tasks with their commands"),
    "localize": (
        "sextant.cli.localize",
        "localize the images of a folder, video, ROS bag or camera in a map, also live",
    ),
    "locate": ("sextant.cli.locate", "estimate the poses of photos or a video from photos with known poses"),
    "walk": ("sextant.cli.walk", "localize images from an uncalibrated camera in a map from another season"),
    "benchmark": ("sextant.cli.benchmark", "evaluate calibration methods on photos from known cameras"),
    "sweep": ("sextant.cli.sweep", "show the status of a sweep running elsewhere, wait for it, or cancel it"),
    "report": ("sextant.cli.report", "write the tables, contrasts and figures of a sweep"),
    "claims": ("sextant.cli.claims", "evaluate the claims of the thesis and write their summary"),
    "data": ("sextant.cli.data", "render datasets on this machine, list or verify them, or describe a map"),
    "runs": ("sextant.cli.runs", "list runs, or delete them from disk and from MLflow"),
    "compare": ("sextant.cli.compare", "compare two runs, and their metrics with the spread over seeds"),
    "replay": ("sextant.cli.replay", "compute the training step again that debug=nan kept"),
    "trajectory": ("sextant.cli.trajectory", "compute the errors of a trajectory: APE, RPE, KITTI's t_rel and r_rel"),
    "export": ("sextant.cli.export", "export the network of a run to ONNX or torch.export"),
    "register": ("sextant.cli.register", "register a run in MLflow's model registry, so that it can be served"),
    "doctor": ("sextant.cli.doctor", "check versions, data, runs and hardware, or the geometry of calibration"),
    "dashboard": ("sextant.cli.dashboard", "open MLflow on this machine"),
}


def main() -> None:
    """Entry point of the ``sextant`` command."""
    run(sys.argv[1] if len(sys.argv) > 1 else "--help", sys.argv[2:])


def run(verb: str, arguments: list[str]) -> None:
    """Run one verb; a user error ends it with one message and exit status 2."""
    with whole_streams():
        if completes(verb, arguments):
            complete(verb, arguments, VERBS)
        elif "--version" in (verb, *arguments):
            print(f"sextant {sextant.__version__}")
        elif verb in ("-h", "--help"):
            print(f"{USAGE}\n\n{_listed_verbs()}")
        else:
            _run_reporting(verb, arguments)


def _run_reporting(verb: str, arguments: list[str]) -> None:
    try:
        with naming_extras(f"sextant {verb}"):
            from sextant.console.console import reporting_mistakes

            with reporting_mistakes(verb):
                _run(verb, arguments)
    except UserError as error:  # a package is missing, perhaps the one that prints
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:  # while the command was being imported
        sys.exit(130)


def _run(verb: str, arguments: list[str]) -> None:
    if verb not in VERBS:
        from sextant.config import nearest

        near = nearest(verb, VERBS)
        hint = f"Did you mean sextant {near}? " if near else ""
        raise UserError(f"sextant {verb}: no such command", f"{hint}Commands:\n{_listed_verbs()}")
    from sextant.tracking.environment import quiet_libraries

    quiet_libraries()
    if not sys.warnoptions:  # warnings of libraries address programmers
        warnings.simplefilter("ignore")
    import_module(VERBS[verb][0]).main([word for argument in arguments for word in spelled_out(argument)])


def _listed_verbs() -> str:
    return "\n".join(f"  {name:<10} {what}" for name, (_, what) in VERBS.items())


def spelled_out(argument: str) -> list[str]:
    """Expand ``descriptor=run:<id>`` (or ``features=``) to the two overrides it abbreviates; keep other arguments."""
    group, _, run = argument.partition("=run:")
    return [f"{group}=run", f"{group}.run={run}"] if group in ("descriptor", "features") and run else [argument]


def run_script(verb: str) -> None:
    """Run one verb with the arguments of the process, for the scripts at the top of the repository."""
    run(verb, sys.argv[1:])
