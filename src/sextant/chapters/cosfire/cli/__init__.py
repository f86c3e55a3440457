"""``predict.py task=cosfire``: detect in images what one example shows; no run is needed.

``options`` and ``inputs`` parse the command line and import nothing heavy. ``filters`` and ``network`` build the
filter, and ``detector`` configures it from the example and detects. ``images`` reads, ``telling`` reports what was
found, and ``predict`` joins them.
"""
