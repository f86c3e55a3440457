"""The kernels of the first layer."""

import torch
from matplotlib.figure import Figure
from torch import nn

from sextant.figures.style import new_figure
from sextant.layers import PushPullConv2d, first_conv, upsample_kernel

MOST = 16


def first_kernels(network: nn.Module) -> Figure | None:
    """Kernels of the first convolution, with the pull kernels of a push-pull layer below; None without one.

    Kernels of three-channel images are shown in colour, others as the mean over their channels; red is positive.

    >>> figure = first_kernels(nn.Sequential(PushPullConv2d(3, 4, 3), nn.ReLU()))
    >>> [axes.get_ylabel() for axes in figure.axes if axes.get_ylabel()], len(figure.axes)
    (['push', 'pull'], 8)
    """
    try:
        _, conv = first_conv(network)
    except ValueError:
        return None
    weight = conv.weight.detach().cpu().float()[:MOST]
    kinds = {"push" if isinstance(conv, PushPullConv2d) else "kernel": weight}
    if isinstance(conv, PushPullConv2d):
        kinds["pull"] = -upsample_kernel(weight, conv.scale)
    figure, axes = new_figure(0.9 * len(weight) + 0.6, 1.0 * len(kinds), rows=len(kinds), columns=len(weight))
    for row, (name, kernels) in enumerate(kinds.items()):
        limit = float(kernels.abs().max()) or 1.0
        for column, kernel in enumerate(kernels):
            cell = axes[row * len(weight) + column]
            if kernel.shape[0] == 3:
                cell.imshow((kernel / (2 * limit) + 0.5).permute(1, 2, 0).numpy())
            else:
                cell.imshow(torch.mean(kernel, 0).numpy(), cmap="RdBu_r", vmin=-limit, vmax=limit)
            cell.set_xticks([])
            cell.set_yticks([])
        axes[row * len(weight)].set_ylabel(name, fontsize=8)
    return figure
