"""A map of which three processes hold a part each answers as one that is whole, and without one of them as the rest."""

import numpy as np
import pytest
import torch

from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.retrieval import FlatIndex
from sextant.retrieval.nearest import joined_neighbours

SIZES, DIMENSIONS, TEMPERATURE = (700, 500, 300), 32, 0.1


class Shard:
    """Opens its part of a map from the disk; all that it sends are answers."""

    def __init__(self, folder):
        self.index = FlatIndex.load(folder)

    def search(self, queries, k):
        return self.index.search(queries, k)

    def log_sum(self, queries):
        """log of the sum of exp(similarity / T) over its images."""
        found = self.index.search(queries, len(self.index)).values
        return AppearanceProposal.of(torch.from_numpy(found).double() / TEMPERATURE).log_total.numpy()


@pytest.fixture(scope="module")
def ray():
    """A Ray of three nodes on this machine."""
    import ray
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    ray.init(address=cluster.address, configure_logging=False)
    yield ray
    ray.shutdown()
    cluster.shutdown()


@pytest.mark.cluster
@pytest.mark.slow
def test_three_shards_answer_as_the_whole_map(ray, tmp_path):
    rng = np.random.default_rng(0)
    rows = rng.normal(size=(sum(SIZES), DIMENSIONS)).astype(np.float32)
    queries = rng.normal(size=(20, DIMENSIONS)).astype(np.float32)
    whole = FlatIndex(rows)
    for number, part in enumerate(np.split(rows, np.cumsum(SIZES)[:-1])):
        FlatIndex(part).save(tmp_path / str(number))
    actor = ray.remote(num_cpus=1)(Shard)  # a process of its own on a node of its own
    shards = [actor.remote(tmp_path / str(number)) for number in range(3)]

    found = ray.get([shard.search.remote(queries, 5) for shard in shards])
    joined, expected = joined_neighbours(found, SIZES, 5), whole.search(queries, 5)
    assert np.array_equal(joined.values, expected.values)
    assert np.array_equal(joined.indices, expected.indices)

    sums = np.stack(ray.get([shard.log_sum.remote(queries) for shard in shards]))
    every = whole.search(queries, len(whole)).values
    total = AppearanceProposal.of(torch.from_numpy(every).double() / TEMPERATURE).log_total.numpy()
    assert np.logaddexp.reduce(sums) == pytest.approx(total, abs=1e-12)

    ray.kill(shards[2])
    with pytest.raises(ray.exceptions.RayActorError):
        ray.get(shards[2].search.remote(queries, 5))
    found = ray.get([shard.search.remote(queries, 5) for shard in shards[:2]])
    without = FlatIndex(rows[: sum(SIZES[:2])]).search(queries, 5)
    assert np.array_equal(joined_neighbours(found, SIZES[:2], 5).indices, without.indices)
