"""``sextant data describe``: describe the photos of a map, in one process or in shards."""

from collections.abc import Mapping, Sequence
from typing import Self

from pydantic import Field

from sextant.applications.arguments import check_apart
from sextant.applications.write_errors import telling_write_errors
from sextant.chapters.places.photo_folder import photos_below
from sextant.console.arguments import Options, UserPath, parse_arguments
from sextant.console.console import console
from sextant.console.work_progress import work_progress
from sextant.console.written import make_output, tell_skipped
from sextant.errors import UserError
from sextant.kit.handler import open_run
from sextant.tables import counted

DESCRIBE = "sextant data describe run=<run> map=<photos> output=<folder> [shards=3 [shard=0]]"
#: key for finding the run, with its meaning
RUN_KEYS = {"outputs": "output folder of runs, if not the default"}


class Sharded(Options):
    """Options of work that can be divided into shards, each with its own process."""

    shards: int | None = Field(None, ge=1, le=10_000, examples=[3])
    """number of shards to divide the work into; without shard=, complete the result from finished shards"""
    shard: int | None = Field(None, ge=0, examples=[0])
    """number of the shard to process, from 0"""

    @classmethod
    def of(cls, given: Mapping[str, str], usage: str | None = None) -> Self:
        """As :meth:`Options.of`; ``shard`` requires ``shards``."""
        if "shard" in given and "shards" not in given:
            raise UserError(f"shard={given['shard']} needs the number of shards: shards= is missing", usage)
        return super().of(given, usage)


class DescribeOptions(Sharded):
    """What the user chose for describing a map."""

    run: str
    """a run of place recognition or its checkpoint; outputs= and trust= as in predict.py"""
    map: str
    """folder of photos"""
    output: UserPath
    """folder for the map, which predict.py takes as map=<folder>"""
    trust: bool = Field(False, examples=["true"])
    """true: build parts that the run names"""


def describe(arguments: Sequence[str]) -> None:
    """Describe photos, or merge the described shards."""
    given = parse_arguments(arguments, DescribeOptions.meanings() | RUN_KEYS, DESCRIBE)
    options = DescribeOptions.of(given, DESCRIBE)
    photos = photos_below(options.map, "map", options.output, one=False)
    check_apart(options.output, map=options.map)
    trained = open_run(given)
    from sextant.chapters.places.map_shards import describe_shard, merge_shards
    from sextant.chapters.places.place_map import PlaceMap

    places = PlaceMap.of(trained.content, trained.found, trust=trained.trust)
    make_output(options.output)
    with telling_write_errors(options.output):  # a photo that cannot be read is among the failed
        if options.shards is not None and options.shard is None:
            failed = merge_shards(places, photos, options.output, options.shards)
        else:
            with work_progress("describing", "photos") as progress:
                failed = describe_shard(places, photos, options.output, options.shard, options.shards or 1, progress)
    tell_skipped(failed)
    console.print(f"{counted(len(places), 'photo')} described: {options.output}", markup=False)
