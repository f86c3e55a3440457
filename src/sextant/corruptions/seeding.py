"""One random stream per corrupted image, so that any single image can be made again on its own."""

import hashlib

import torch
from jaxtyping import Int64
from torch import Tensor


def image_seeds(name: str, level: float, indices: Int64[Tensor, "b"], seed: int) -> list[int]:
    """A 63-bit seed for each image: a hash of (seed, corruption, severity, image index)."""
    key = f"{seed}/{name}/{float(level)!r}/".encode()
    digests = (hashlib.blake2b(key + str(i).encode(), digest_size=8).digest() for i in indices.tolist())
    return [int.from_bytes(digest, "little") >> 1 for digest in digests]


def generators(seeds: list[int]) -> list[torch.Generator]:
    """One CPU generator per seed; draws are made on the CPU, so every device sees the same corrupted image."""
    return [torch.Generator().manual_seed(seed) for seed in seeds]
