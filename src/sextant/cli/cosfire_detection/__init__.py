"""``predict.py task=cosfire``: where in images is what one example shows; no run is needed.

``options`` and ``inputs`` are what the command line gives and import nothing heavy; ``filters`` and ``network`` build
the filter, ``detector`` configures it from the example and finds; ``images`` reads, ``telling`` reports
what was found, and ``predict`` joins them.
"""
