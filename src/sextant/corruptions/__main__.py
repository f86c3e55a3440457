"""``python -m sextant.corruptions make ...``: write corrupted images to files."""

import sys
from importlib import import_module

if __name__ == "__main__":
    # the command belongs to the layer above, which this package must not import
    import_module("sextant.cli.corruptions_make").run(sys.argv[1:])
