"""``predict.py`` with a place descriptor: find photos of a map that show the same places as other photos.

The network describes all photos of the map and of the queries. Each query gets its most similar map images and the
probability that they show its place. This is the posterior of :mod:`~sextant.evaluation.posterior` over the map,
at the temperature that the run's test fitted on the validation split. If the queries form a drive, sequences of them
can be matched as well.

Nothing is imported here, and :mod:`~sextant.chapters.places.cli.options` and :mod:`~sextant.chapters.places.cli.inputs`
do not import torch, so that mistakes in a command are reported at once.
"""
