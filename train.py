"""``sextant train`` from a checkout."""

from sextant.cli import run_script

run_script("train")
