"""``make gpu-claims``: runs on a GPU for the board of claims, in blocks of at most eight minutes.

Without an argument it lists the blocks: the plans of chapter 7's claims, whose ResNet-20 trains on images in memory,
and its named ablations of that network. Other chapters are left out, as rendering their worlds and cutting their crops
on the CPU takes longer than their networks. With the number of a block it runs that block. Finished runs are kept, and
the same command resumes an interrupted run from its last checkpoint.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks.machine import run_for
from sextant.errors import UserError, command
from sextant.lifecycle.claim_files import read_claims
from sextant.lifecycle.claim_plan import plan_claims
from sextant.lifecycle.claims import Tables, stored_results
from sextant.lifecycle.sweep_plan import read_design

ROOT = Path(__file__).parents[1]
LIMIT_S = 480
#: core-minutes of an AMD EPYC that a minute of an NVIDIA H100 with 16 cores and 16 runs at once replaces: 16 runs of 60
#: epochs took 8 minutes there (results/push_pull.md), and 0.6 core-hours each here
CORE_MINUTES = 16 * 0.6 * 60 / 8
#: minutes that blocks are planned for, so that their start fits in as well
PLANNED = 7.0
#: named ablations of ResNet-20 with their core-hours
ABLATIONS = {"pushpull_placement": 6.0, "pushpull_stages": 3.0}
ON_A_GPU = ("trainer.accelerator=gpu", "trainer.precision=32-true", "launcher=joblib", "launcher.workers=16")


@dataclass(frozen=True)
class Block:
    """Some runs of a design.

    Attributes:
        name: their claims or sweep.
        arguments: arguments of ``train.py``.
        minutes: estimated duration.
    """

    name: str
    arguments: tuple[str, ...]
    minutes: float


def blocks() -> list[Block]:
    """All blocks, in order."""
    wanted: dict[tuple[str, ...], tuple[list[str], float]] = {}
    claims = {name: claim for name, claim in read_claims().items() if claim.chapter == 7}
    for plan in plan_claims(claims, Tables(stored_results())):
        names, hours = wanted.get(tuple(plan.arguments), ([], plan.core_hours))
        wanted[tuple(plan.arguments)] = ([*names, plan.name], hours)
    for sweep, hours in ABLATIONS.items():
        wanted[f"sweep={sweep}", "experiment=resnet_cifar10_small"] = ([sweep], hours)
    found = []
    for arguments, (names, hours) in wanted.items():
        minutes = 60 * hours / CORE_MINUTES
        count = min(math.ceil(minutes / PLANNED), len(read_design(arguments).seeds))
        for number in range(1, count + 1):
            block = (*arguments, f"sweep.block={number}/{count}", *ON_A_GPU)
            found.append(Block(", ".join(names), block, minutes / count))
    return found


def main(arguments: list[str]) -> None:
    """List the blocks, or run one."""
    found = blocks()
    if not arguments:
        for number, block in enumerate(found, 1):
            print(f"{number}  {block.minutes:.0f} min  {block.name}\n   {command('train', '-m', *block.arguments)}")
        print(f"together {sum(block.minutes for block in found):.0f} minutes; make gpu-claims BLOCK=1 runs the first")
        return
    if not (arguments[0].isdecimal() and 1 <= int(arguments[0]) <= len(found)):
        raise UserError(f"BLOCK={arguments[0]} must be a number from 1 to {len(found)}", "make gpu-claims lists them.")
    if not torch.cuda.is_available():
        print("no CUDA device was found on this machine: nothing was run", file=sys.stderr)
        raise SystemExit(2)
    raise SystemExit(run([sys.executable, "train.py", "-m", *found[int(arguments[0]) - 1].arguments]))


def run(words: list[str], seconds: float = LIMIT_S) -> int:
    """Run a command for at most ``seconds``; its exit status, or 124 if it was interrupted."""
    status = run_for(seconds, words, ROOT)
    if status == 124:
        print(f"stopped after {seconds:.0f} s; the same command resumes it", file=sys.stderr)
    return status


if __name__ == "__main__":
    try:
        main([word for word in sys.argv[1:] if word])
    except UserError as error:
        raise SystemExit(str(error)) from None
