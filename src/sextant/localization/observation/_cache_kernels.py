r"""Computations of one pose with the cache of its neighbourhood, compiled to machine code.

Lower triangles are packed row by row: entry (i, j <= i) is at ``i (i + 1) / 2 + j``. Arithmetic is in float64.
"""

import math
from functools import partial

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.core import cgutils, types
from numba.extending import intrinsic

from sextant.compiled import compiled as machine_code

RBF, MATERN32, MATERN52 = 0, 1, 2
#: Size of a cache line.
BYTES = 64
#: Number of poses between prefetching memory and using it.
AHEAD = 4


#: sums may be reordered, which is faster as several terms are added at a time
compiled = partial(machine_code, fastmath={"contract", "reassoc", "nsz"})


@intrinsic
def _ask_for(context, address):  # type: ignore[no-untyped-def]
    """Prefetch the cache line at an address, without waiting for it."""

    def emit(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        pointer, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [pointer, number, number, number])
        # with the type of the pointer in its name, which LLVM 15 needs and later ones drop
        ask = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        to_read, keep, data = (number(value) for value in (0, 3, 1))
        builder.call(ask, [builder.inttoptr(arguments[0], pointer), to_read, keep, data])
        return context.get_dummy_value()  # Numba's value of a function that returns nothing

    return types.void(types.uintp), emit


@compiled
def ask_for(matrix, row, column, count):  # type: ignore[no-untyped-def]
    """Prefetch ``count`` values of a row."""
    start = matrix.ctypes.data + (row * matrix.shape[1] + column) * matrix.itemsize
    last = start + count * matrix.itemsize - 1
    for at in range(start, last, BYTES):
        _ask_for(at)  # type: ignore[call-arg]
    _ask_for(last)  # type: ignore[call-arg]


@compiled
def covariance(spatial, variance, a, b):  # type: ignore[no-untyped-def]
    """The covariance of :class:`PoseKernel` between two poses, given their features."""
    x, y, cosine, sine = a[0] - b[0], a[1] - b[1], a[2] - b[2], a[3] - b[3]
    square, chord = x * x + y * y, cosine * cosine + sine * sine
    if spatial == RBF:
        return variance * math.exp(-0.5 * (square + chord))
    if spatial == MATERN32:
        scaled = math.sqrt(3 * square)
        return variance * (1 + scaled) * math.exp(-scaled - 0.5 * chord)
    scaled = math.sqrt(5 * square)
    return variance * (1 + scaled + scaled * scaled / 3) * math.exp(-scaled - 0.5 * chord)


@compiled
def gram_residuals(  # type: ignore[no-untyped-def]
    spatial,
    variance,
    features,
    runs,
    images,
    map_features,
    neighbours,
    whiteners,
    grams,
    products,
    offsets,
    norms,
    squared,
    explained,
):
    r"""Squared distance of descriptors to predicted means, and the variance that the map explains.

    With :math:`v = L^{-1} k_N`, :math:`u = L^{-1} Y_c z_c` and M the Gram matrix of :math:`L^{-1} Y_c`:
    :math:`\|z - \mu\|^2 = \|z_c\|^2 - 2 v^T u + v^T M v` and :math:`\|v\|^2`.

    Args:
        spatial: RBF, MATERN32 or MATERN52.
        variance: variance of the signal.
        features: ``(m, 4)`` features of the poses.
        runs: ``(m,)`` the run whose descriptor is compared.
        images: ``(m,)`` the image of the map whose cache is used.
        map_features: ``(n, 4)`` features of the map's poses.
        neighbours: ``(n, k)`` neighbours of the map's images.
        whiteners: ``(n, k (k + 1) / 2)`` packed :math:`L^{-1}`.
        grams: ``(n, k (k + 1) / 2)`` packed M.
        products: ``(r, n)`` products of the map's descriptors with the centred descriptors of the runs.
        offsets: ``(r,)`` products of the map's mean with the centred descriptors.
        norms: ``(r,)`` squared norms of the centred descriptors.
        squared: ``(m,)`` written.
        explained: ``(m,)`` written.

    """
    k = neighbours.shape[1]
    across, seen, known = np.empty(k), np.empty(k), np.empty(k)
    for pose in range(len(images)):
        # with particles spread over a city, nearly all the time is spent waiting for memory: prefetch it
        later = pose + 2 * AHEAD
        if later < len(images):
            ask_for(neighbours, images[later], 0, k)
        later = pose + AHEAD
        if later < len(images):
            image, run = images[later], runs[later]
            ask_for(whiteners, image, 0, whiteners.shape[1])
            ask_for(grams, image, 0, grams.shape[1])
            for j in range(k):
                row = neighbours[image, j]
                ask_for(map_features, row, 0, 4)
                ask_for(products, run, row, 1)
        image, run = images[pose], runs[pose]
        offset = offsets[run]
        for j in range(k):
            row = neighbours[image, j]
            across[j] = covariance(spatial, variance, features[pose], map_features[row])
            seen[j] = products[run, row] - offset
        start = 0
        length, linear, quadratic = 0.0, 0.0, 0.0
        for i in range(k):
            whitened, whitened_seen = 0.0, 0.0
            for j in range(i + 1):
                factor = np.float64(whiteners[image, start + j])
                whitened += factor * across[j]
                whitened_seen += factor * seen[j]
            known[i] = whitened
            earlier = 0.0
            for j in range(i):
                earlier += np.float64(grams[image, start + j]) * known[j]
            quadratic += whitened * (2 * earlier + np.float64(grams[image, start + i]) * whitened)
            length += whitened * whitened
            linear += whitened * whitened_seen
            start += i + 1
        distance = norms[run] - 2 * linear + quadratic
        squared[pose] = 0.0 if distance < 0 else distance  # rounding; nan stays nan
        explained[pose] = length


@compiled
def interpolation_weights(  # type: ignore[no-untyped-def]
    spatial, variance, features, images, map_features, neighbours, whiteners, weights, explained
):
    r"""Weights :math:`w = L^{-T} L^{-1} k_N` of the neighbours' descriptors, and the variance explained.

    Args: as for :func:`gram_residuals`; ``weights`` ``(m, k)`` is written.
    """
    k = neighbours.shape[1]
    across = np.empty(k)
    for pose in range(len(images)):
        image = images[pose]
        for j in range(k):
            across[j] = covariance(spatial, variance, features[pose], map_features[neighbours[image, j]])
            weights[pose, j] = 0.0
        start = 0
        length = 0.0
        for i in range(k):
            whitened = 0.0
            for j in range(i + 1):
                whitened += np.float64(whiteners[image, start + j]) * across[j]
            for j in range(i + 1):
                weights[pose, j] += np.float64(whiteners[image, start + j]) * whitened
            length += whitened * whitened
            start += i + 1
        explained[pose] = length


@compiled
def mean_scores(  # type: ignore[no-untyped-def]
    weights, neighbours, products, offsets, norms, levels, slopes, out
):
    r"""``out[r, i] = levels[r, i] + slopes[r, i] (2 m_ri - norms[r])``, m the product of a run's descriptor and a mean.

    .. math:: m_{ri} = \sum_j \mathrm{weights}_{ij} \, (\mathrm{products}_{r, N(i, j)} - \mathrm{offsets}_r)

    This is summed in float32, the type of the products, as one instruction then handles twice as many. Levels and
    slopes of one row are those of all runs.
    """
    for run in range(len(products)):
        level, slope = levels[min(run, len(levels) - 1)], slopes[min(run, len(slopes) - 1)]
        row, offset, norm = products[run], np.float32(offsets[run]), norms[run]
        for image in range(len(neighbours)):
            shares, near = weights[image], neighbours[image]
            total = np.float32(0)
            for j in range(len(near)):
                total += shares[j] * (row[np.uint32(near[j])] - offset)  # unsigned: saves the test for negative indices
            out[run, image] = level[image] + slope[image] * (2 * np.float64(total) - norm)


@compiled
def image_scores(products, constants, levels, slopes, out):  # type: ignore[no-untyped-def]
    """``out[r, i] = levels[r, i] + slopes[r, i] (2 products[r, i] - constants[r])``; see :func:`mean_scores`."""
    for run in range(len(products)):
        level, slope = levels[min(run, len(levels) - 1)], slopes[min(run, len(slopes) - 1)]
        for image in range(len(level)):
            out[run, image] = level[image] + slope[image] * (2 * np.float64(products[run, image]) - constants[run])


@compiled
def rounded_products(values, scales, vector, out):  # type: ignore[no-untyped-def]
    """``out[i] = scales[i] sum_j values[i, j] vector[j]`` of values of eight bits, summed in float32."""
    for row in range(len(values)):
        total = np.float32(0)
        for j in range(len(vector)):
            total += np.float32(values[row, j]) * vector[j]
        out[row] = scales[row] * total
