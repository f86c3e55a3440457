"""Matching of places in ``predict.py``. Imports nothing heavy."""

from collections.abc import Mapping
from pathlib import Path

from sextant.chapters.places.options import INPUTS, PlaceInputs, PlaceOptions, read_inputs
from sextant.console.written import make_output
from sextant.errors import UserError
from sextant.kit.handler import Handler, Trained, open_run, require


class PlaceMatching(Handler):
    """Finds the photos of a map that show the same places as the queries."""

    task = "place_recognition"
    topic = "places"
    usage = "sextant predict run=<...> map=<folder> queries=<folder> [output=matches]"
    keys = INPUTS | PlaceOptions.meanings()
    needs = tuple(INPUTS)
    shared = ("run", "output", "outputs", "trust")
    named_by = "map= and queries="

    def claims(self, given: Mapping[str, str]) -> bool:
        """Whether a map or queries are given."""
        return any(key in given for key in INPUTS)

    def predict(self, given: Mapping[str, str]) -> None:
        """Look queries up in the map."""
        elsewhere = bool(PlaceOptions.of(given).given)
        if not elsewhere:
            require(given, ("run",), self.usage)
        inputs = read_inputs(given)
        if elsewhere:
            _predict_given(given, inputs)
            return
        make_output(inputs.output)
        trained = open_run(given)
        if trained.task != self.task:
            raise UserError(f"map= belongs to {self.task}; this is a model of {trained.task}", Handler.usage)
        from sextant.chapters.places.place_map import PlaceMap
        from sextant.chapters.places.predict import predict_places
        from sextant.chapters.places.saved_map import run_facts

        places = PlaceMap.of(trained.content, trained.found, trust=trained.trust)
        predict_places(places, inputs, run_facts(trained.reference, trained.found, places.model, trained.about))

    def predict_photos(self, given: Mapping[str, str], trained: Trained, paths: list[Path], output: Path) -> None:
        """Refuse photos without a map."""
        raise UserError(
            f"run={trained.reference}: input= does not take models of place_recognition, which need a map",
            self.usage,
        )


def _predict_given(given: Mapping[str, str], inputs: PlaceInputs) -> None:
    """Look queries up in the map, by descriptors that were computed elsewhere."""
    if "run" in given:
        raise UserError(
            f"run={given['run']}: descriptors={inputs.options.descriptors} are computed elsewhere", "Leave out one."
        )
    from sextant.chapters.places.given_descriptors import GivenDescriptors, open_rows
    from sextant.chapters.places.place_map import PlaceMap
    from sextant.chapters.places.predict import predict_places
    from sextant.chapters.places.saved_map import ELSEWHERE

    files = inputs.options.given
    dimension = open_rows(files["map"], "descriptors").shape[-1]
    make_output(inputs.output)
    told = {key: str(path) for key, path in files.items()}
    predict_places(PlaceMap(GivenDescriptors(dimension), temperature=ELSEWHERE), inputs, {"run": None, **told})


HANDLERS = (PlaceMatching,)
