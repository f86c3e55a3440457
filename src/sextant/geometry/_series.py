"""Quotients that are smooth at angle 0, as functions of the squared angle, where their usual form is 0 / 0."""

import math

import torch
from torch import Tensor

TERMS = 10  # below a squared angle of 1 the next term is under 1e-17


def sinc_of_square(square: Tensor) -> Tensor:
    """``sin(a) / a`` of ``square = a^2 >= 0``, smooth at 0; accurate to rounding, with its derivatives."""
    small = square < 1
    angle = torch.where(small, 1, square).sqrt()
    return torch.where(small, _alternating(torch.where(small, square, 0), first=1), torch.sin(angle) / angle)


def sinc_deficit_of_square(square: Tensor) -> Tensor:
    """``(a - sin(a)) / a^3`` of ``square = a^2 >= 0``, smooth at 0."""
    small = square < 1
    large = torch.where(small, 1, square)
    return torch.where(small, _alternating(torch.where(small, square, 0), first=3), (1 - sinc_of_square(large)) / large)


def _alternating(square: Tensor, first: int) -> Tensor:
    """``sum over k of (-square)^k / (first + 2 k)!`` by Horner's rule."""
    total = torch.zeros_like(square)
    for k in reversed(range(TERMS)):
        total = 1 / math.factorial(first + 2 * k) - square * total
    return total
