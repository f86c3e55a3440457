r"""B-COSFIRE: delineates bar-shaped structures (vessels, cracks, roads) by one filter for bars and one for their ends.

.. math:: R = R_{\text{symmetric}} + R_{\text{asymmetric}}, \qquad
    \text{vessel where } 255\,\frac{R - \min R}{\max R - \min R} > t

Source: G. Azzopardi, N. Strisciuglio, M. Vento, N. Petkov, "Trainable COSFIRE filters for vessel delineation with
application to retinal images", Medical Image Analysis 19, 2015.
"""

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from sextant.errors import ArgumentError
from sextant.layers.cosfire.cosfire import Cosfire
from sextant.layers.cosfire.presets import preset


class BCosfire(nn.Module):
    """The filters for bars and for their ends, both configured from a straight bar.

    >>> image = torch.zeros(1, 1, 40, 40)
    >>> image[..., 20:23] = 1  # an upright vessel
    >>> BCosfire().segment(image)[0, 20].nonzero().flatten()
    tensor([19, 20, 21, 22, 23])

    Args:
        bar: the symmetric filter, not yet configured.
        end: the filter that becomes asymmetric: its parts on one side of the centre are removed.
        bar_length: side of the prototype in pixels; long enough for the largest radius and its blur.
    """

    bar: Cosfire
    end: Cosfire

    def __init__(self, bar: Cosfire | None = None, end: Cosfire | None = None, bar_length: int = 201):
        super().__init__()
        # not ``bar or preset(...)``: a filter that is not configured yet is false
        self.bar = preset("vessel_drive") if bar is None else bar
        self.end = preset("vessel_end_drive") if end is None else end
        prototype = torch.zeros(1, bar_length, bar_length, dtype=torch.float64)
        prototype[:, :, bar_length // 2] = 1
        self.bar.configure(prototype)
        self.end.configure(prototype).keep(lambda tuples: torch.remainder(tuples.phi, 2 * torch.pi) <= torch.pi + 1e-9)

    def forward(self, images: Float[Tensor, "b 1 h w"]) -> Float[Tensor, "b h w"]:
        """The response R, for images in which the bars are bright (the retina's green channel, inverted)."""
        return (self.bar(images) + self.end(images))[:, 0]  # type: ignore[no-any-return]

    def segment(
        self, images: Float[Tensor, "b 1 h w"], mask: Bool[Tensor, "b h w"] | None = None, threshold: float = 37.0
    ) -> Bool[Tensor, "b h w"]:
        """Where the response, scaled to 0 to 255 per image, exceeds ``threshold`` (37 DRIVE, 40 STARE, 38 CHASE_DB1).

        Args:
            mask: the field of view; outside it the response counts as 0.

        Raises:
            ArgumentError: ``threshold`` is nan.
        """
        if math.isnan(threshold):
            raise ArgumentError(f"threshold={threshold} must be a number", "For example threshold=37.0")
        response = self(images)
        return scaled(response if mask is None else response * mask) > threshold


def scaled(response: Float[Tensor, "b h w"]) -> Float[Tensor, "b h w"]:
    """Scale each response so that its minimum is 0 and its maximum 255."""
    least, most = (extreme(response, dim=(1, 2), keepdim=True) for extreme in (torch.amin, torch.amax))
    return 255 * (response - least) / (most - least).clamp(min=torch.finfo(response.dtype).tiny)
