"""``predict.py`` with a place descriptor: which photos of a map show the places of other photos.

All photos of a map and of the queries are described by the network. Each query gets its most similar map images and the
probability that they show its place: the posterior of :mod:`~sextant.evaluation.places.posterior` over the map, at the
temperature that the run's test fitted on the validation split. Where the queries are a ride, sequences of them can be
matched as well.

Nothing is imported here, and :mod:`~sextant.cli.place_matching.options` and :mod:`~sextant.cli.place_matching.inputs`
import no torch: mistakes in a command are told at once.
"""
