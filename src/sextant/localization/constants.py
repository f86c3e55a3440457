"""The numbers of localization that were chosen by hand; all others follow from the map, its kernel or the drive.

Each has its reason, and how it was chosen. ``tests/localization/test_constants.py`` counts them and finds numbers in
other modules. Not listed are limits of computing (sizes of blocks, samples, tolerances), which change no estimate
beyond noise, and the published settings of alternatives such as laser models, which a configuration names.
Measurements are in results/localization_change.md unless another file is named; ``changed_walks`` stands for
``python -m benchmarks.changed_walks``.
"""

import math

# -- the evidence of an image -----------------------------------------------------------------------------------------

#: how much likelier the most similar places of the map become than the least similar, by one image. Published: 5 (Xu et
#: al. 2021), with which a thousand particles start too slowly in a town; from 5, 10, 20 and 50 (lab/localization.md).
#: Without it regions hold the truth at Gardens Point by day 58 times in 100, not 98: ``changed_walks seeds=8``
ODDS = 20.0
#: factor of the log-likelihood of an image by a map that was fitted to no other traverse, the most that it keeps. Of
#: 1/64, 1/8 and 1 (lab/localization.md)
TEMPERING = 0.125
#: factor of the appearance variance by which the most similar image of a map exceeds the predicted one: a minimum over
#: many images is biased low. Of 1, 1.5 and 2: with 1 the railway takes another world for itself in 16 % of the steps
#: without odometry, with 2 a camera that stands, walks and runs is found less often than by the nearest image (lab)
EXCESS = 1.5
#: factor of the fitted kernel's lengths. What tells places apart looks like noise to a kernel fitted to one traverse,
#: and its noise variance is capped at a share of the signal's. From 24 combinations. Of the railway's first
#: stretch 40 and 39 % are found without either of the two (lab/localization.md), without both 50, with them 100:
#: ``changed_walks seeds=8``. With a tenth of the noise no difference was shown in four towns and on seven walks; four
#: offices are too few: ``switch_offs``
SHARPER, NOISE = 0.5, 1e-3

# -- support of the map, and restarts ---------------------------------------------------------------------------------

#: probability that is set aside for what the model leaves out: a robot off the map, a kidnapping before an image, an
#: image that shows something else than its place, and the part of the belief that a covariance does not describe.
#: Without support the default finds 0 to 64 %: ``changed_walks seeds=8``, "without support"
RARE = 0.01
#: how far a camera may be turned from the map's nearest image, in rad, where the map does not show it
HEADING_REACH = math.radians(10)
#: how far images of a dense map represent poses beside them, in lengths of its kernel. NLL of the office's poses -1.7,
#: without it -0.1 ("A map reaches half its spacing")
LENGTHS = 1.5
#: size of a place in spacings of the map, and in heading in ``HEADING_REACH``: radius of the mode that is reported;
#: images of two places are twice as far apart; and a map is dense if its kernel is longer, and has more signal than
#: noise. With 2 in place of 2.5 two towns of four, whose kernels are 2.1 and 2.3 spacings long, count as dense, and
#: ``LENGTHS`` reaches into the houses: ``switch_offs``
PLACE = 2.5

# -- motion -----------------------------------------------------------------------------------------------------------

#: standard deviation of odometry after one spacing of the map, in spacings. From 0.1, 0.2 and 0.3, two seeds. Wheels
#: err by a tenth, but alike in each step: with a tenth the tower is found in 25 and 16 %: ``changed_walks seeds=8
#: odometry=true``
ODOMETRY = 0.3
#: standard deviation of an unknown motion in spacings of the map; an estimate that errs by more is at another place,
#: and teaches nothing about odometry. From 1, 2 and 3, two seeds
UNKNOWN = 2.0
#: errors across the heading as a share of those along it, and of the heading in rad as one of those in spacings
ASIDE = 0.1
#: how many times as far as an unknown motion particles spread that turn back or drive much faster, or turn a corner;
#: and the largest factor by which odometry may be wrong
FURTHER = 4.0
#: one particle in this many turns back or drives faster where there is a pace, and one turns a corner; one in 6 and one
#: in 4 were no better (lab/localization.md). Its inverse is also the prior probability of a standstill, not varied
ONE_IN = 5

# -- what is remembered of a drive, and verdicts ----------------------------------------------------------------------

#: number of images, or displacements, needed for a verdict; after as many, half of a change of appearance is removed
FEW = 5
#: number of past images that weigh a restart, and of displacements that make up a pace. Without a window the tower is
#: found in 63 and 51 % instead of 85 and 81: ``changed_walks seeds=8``, "without window"
WINDOW = 10
#: number of images that a verdict is about; an error of odometry is corrected over as many spacings. From 10, 20 and
#: 30; a gain of 1/10 costs a point where odometry is right
RECENT = 20
#: a belief that foresees images less than this is lost. From 0.6 to 0.75, with two seeds of Gardens Point and of the
#: railway
FORESEEN = 0.65
#: images that are recognised less than this are not of the map ("does the map show this place at all?")
RECOGNISED = 0.4
#: squared distances between images of a robot that moves exceed this share of those between any two images of the map:
#: at a station 0.02 at most, with noise and compression 0.18, on walks 0.32 and more ("Odometry of zeros from a moving
#: camera is not believed"). The same share of the step between neighbouring images, in distance and in squared change,
#: is what an image must be new by to count; it replaces 1/4
ALIKE = 0.2
