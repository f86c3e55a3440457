"""``sextant evaluate`` from a checkout."""

from sextant.cli import run_script

run_script("evaluate")
