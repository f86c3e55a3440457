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
    "evaluate": ("sextant.cli.evaluate", "test a trained model, under other data or corruptions"),
    "predict": ("sextant.cli.predict", "classify images, calibrate photos, find places, or detect an example"),
    "demo": ("sextant.cli.demo", "see in a browser what Sextant does, with photos of your own"),
    "inspect": ("sextant.cli.inspect", "look at your own photos, video or poses: what fits them, with the commands"),
    "localize": (
        "sextant.cli.localize",
        "where the images of a folder, video, ROS bag or camera were taken, also live",
    ),
    "locate": ("sextant.cli.locate", "the poses of photos or a video, among photos with poses"),
    "walk": ("sextant.cli.walk", "localize images of an unknown camera in a map of another season"),
    "benchmark": ("sextant.cli.benchmark", "measure calibration on photos of known cameras, in one table"),
    "sweep": ("sextant.cli.sweep", "status of a sweep that runs elsewhere; attach to it, or cancel it"),
    "report": ("sextant.cli.report", "tables, contrasts and figures of a sweep"),
    "claims": ("sextant.cli.claims", "decide the claims of the thesis, and write their board"),
    "data": ("sextant.cli.data", "list, render or verify the datasets that are rendered here"),
    "runs": ("sextant.cli.runs", "list runs, or delete them from disk and store together"),
    "compare": ("sextant.cli.compare", "what two runs differ in, and whether seeds alone make their metrics differ so"),
    "trajectory": ("sextant.cli.trajectory", "errors of an estimated trajectory: APE, RPE, KITTI's t_rel and r_rel"),
    "export": ("sextant.cli.export", "write the network of a run as ONNX or for torch.export"),
    "register": ("sextant.cli.register", "make a run a model of MLflow's registry, which can be served"),
    "doctor": ("sextant.cli.doctor", "look at versions, data, runs and hardware; or check the geometry of calibration"),
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
