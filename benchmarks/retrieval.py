"""Search of one query, and of many, among 172,000 descriptors of dimension 128: against memory bandwidth and faiss.

Tasks alternate, so that all run under the same load, and ratios are of the medians of one run. Agreement of the
neighbours is checked first.
"""

from collections.abc import Callable

import numpy as np
import torch

from benchmarks.push_pull_timing import medians
from sextant.retrieval.flat_index import FlatIndex

COUNT, DIMENSION, K, BATCH, REPEATS = 172_000, 128, 20, 64, 41
#: Correlation of neighbouring descriptors: consecutive places look similar.
ALONG_TRACK = 0.5

Row = tuple[str, str, str, str, str]


def run(count: int = COUNT, repeats: int = REPEATS) -> list[Row]:
    reference, queries = traverse(count), traverse(BATCH, seed=1)
    index, query = FlatIndex(reference), queries[:1]
    unit = index.references.rows
    theirs = _faiss(unit)
    single: dict[str, Callable[[], object]] = {
        "ours": lambda: index.search(query, K),
        "numpy sgemv": lambda: unit @ query[0],
        "torch sgemv": _torch(unit, query[0]),
        "naive argsort": lambda: np.argsort(np.linalg.norm(unit - query[0], axis=1))[:K],
    }
    many: dict[str, Callable[[], object]] = {
        "ours": lambda: index.search(queries, K),
        "numpy gemm": lambda: queries @ unit.T,
    }
    if theirs is not None:
        single["faiss flat"], many["faiss flat"] = lambda: theirs(query), lambda: theirs(queries)
        agree = np.array_equal(index.search(queries, K).indices, theirs(queries))
    # sorting takes longer than all the others together
    seconds = medians(single, repeats, seldom=["naive argsort"])
    together = medians(many, max(3, repeats // 8))
    fastest = min(("numpy sgemv", "torch sgemv"), key=seconds.__getitem__)
    what = f"one query, {count:,} x {DIMENSION}, k={K}"
    rows = [
        _row(what, seconds, fastest, "<= 1.5"),
        _row(what, seconds, "naive argsort", "<= 0.067"),
        _row(f"{BATCH} queries", together, "numpy gemm", ""),
    ]
    if theirs is None:
        return [*rows, (what, "", "faiss-cpu is not installed", "", "<= 1")]
    rows.insert(1, _row(what, seconds, "faiss flat", "<= 1"))
    rows.append(_row(f"{BATCH} queries", together, "faiss flat", "<= 1"))
    return [*rows, ("neighbours like faiss flat's", "all the same" if agree else "DIFFERENT", "", "", "all the same")]


def traverse(count: int, dimension: int = DIMENSION, seed: int = 0) -> np.ndarray:
    """Random descriptors of norm one, correlated along the track."""
    noise = np.random.default_rng(seed).normal(size=(count, dimension)).astype(np.float32)
    noise[1:] += ALONG_TRACK / (1 - ALONG_TRACK) * noise[:-1]
    return np.asarray(noise / np.linalg.norm(noise, axis=1, keepdims=True), np.float32)


def _row(what: str, seconds: dict[str, float], against: str, aim: str) -> Row:
    ours, other = seconds["ours"], seconds[against]
    return what, f"{1e3 * ours:.2f} ms", f"{against} {1e3 * other:.2f} ms", f"{ours / other:.2f}", aim


def _torch(rows: np.ndarray, query: np.ndarray) -> Callable[[], object]:
    matrix, vector = torch.from_numpy(rows), torch.from_numpy(query)
    return lambda: torch.mv(matrix, vector)


def _faiss(rows: np.ndarray) -> Callable[[np.ndarray], np.ndarray] | None:
    try:
        import faiss
    except ImportError:
        return None
    index = faiss.IndexFlatIP(rows.shape[1])
    index.add(rows)
    return lambda queries: index.search(queries, K)[1]
