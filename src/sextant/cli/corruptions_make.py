"""``python -m sextant.corruptions make``: files of corrupted images in the layout of CIFAR-10-C."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from sextant.cli.data_describe import Sharded
from sextant.cli.streams import whole_streams
from sextant.cli.terminal import TERMINAL
from sextant.console.arguments import SPLIT, UserPath
from sextant.console.console import print_key_values, reporting_mistakes
from sextant.errors import UserError

USAGE = "python -m sextant.corruptions make set=cifar10_c input=cifar10 output=CIFAR-10-C [shards=3 [shard=0]]"
Mode = Literal["faithful", "corrected"]


class MakeOptions(Sharded):
    """What the user chose."""

    benchmark: str = Field(alias="set")
    """benchmark whose parameters are used: cifar10_c, cifar100_c, mnist_c or imagenet_c"""
    input: str
    """a dataset such as cifar10, whose test split is used, or a .npy file of uint8 (n, h, w[, c])"""
    output: UserPath
    """folder for the files"""
    names: Annotated[tuple[str, ...], SPLIT] = ()
    """corruptions or groups of them, separated by commas (default: all)"""
    severities: Annotated[tuple[Literal["1", "2", "3", "4", "5"], ...], SPLIT] = Field(
        (), title="some of 1,2,3,4,5", examples=["1,3,5"]
    )
    """some of 1,2,3,4,5 (default: the published ones)"""
    seed: int = Field(0, ge=0, examples=[0])
    """seed of all random draws (default: 0)"""
    mode: Mode = Field("faithful", examples=["corrected"])
    """faithful to the authors' code (default), or corrected"""
    labels: str | None = None
    """a .npy file of n labels to write beside the images (default: the dataset's)"""
    device: str = "cpu"
    """device to compute on (default: cpu)"""


def run(arguments: Sequence[str]) -> None:
    """Run the command; a user error ends it with one message and exit status 2."""
    with whole_streams(), reporting_mistakes("corruptions"):
        main(arguments)


def main(arguments: Sequence[str]) -> None:
    """Parse ``make key=value ...`` and write the files.

    Raises:
        UserError: an argument is wrong, the input cannot be read, or the output cannot be written.
    """
    verb, *rest = arguments or ("",)
    if verb in ("-h", "--help", ""):
        rest = ["--help"]
    elif verb != "make":
        raise UserError(f"{verb}: not understood", USAGE)
    options = MakeOptions.parse(rest, USAGE)

    from sextant.lifecycle.corruption_files import make_corruptions

    made = make_corruptions(
        options.benchmark,
        options.input,
        options.output,
        names=options.names,
        severities=[int(each) for each in options.severities],
        seed=options.seed,
        mode=options.mode,
        labels=options.labels,
        device=options.device,
        shards=options.shards or 1,
        shard=options.shard,
        reporter=TERMINAL,
    )
    shape = " x ".join(map(str, made.shape[1:]))
    rows = {"images": f"{made.shape[0]:,} of {shape}", "mode": options.mode, "seed": str(options.seed)}
    rows |= {"made": f"{made.made} corruptions", "kept": f"{made.kept}", "seconds": f"{made.seconds:,.1f}"}
    print_key_values(options.benchmark, rows | {"path": str(options.output)})
