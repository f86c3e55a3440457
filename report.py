"""``sextant report`` from a checkout."""

from sextant.cli import run_script

run_script("report")
