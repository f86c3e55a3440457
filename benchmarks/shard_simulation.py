"""A cluster with a map of 100 million images in shards, simulated with constants measured on one core of this machine.

A step of a robot's filter requests likelihoods from the shards with its particles and, if the step restarts particles,
the evidence of the images from every shard: its sum, and draws. The step ends with the slowest response. A shard has
replicas; a request goes to one at random. A replica processes all waiting requests, up to a limit, as one product of
matrices, and is then busy for

    fixed + seconds of the product for its images + requests x seconds of passes over the scores

times a random factor. The network adds a round trip. Robots' steps arrive at random times at a constant rate.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float64
from numpy import ndarray

from benchmarks.localization import LIKELIHOOD
from sextant.localization.appearance_proposal import AppearanceProposal
from sextant.localization.observation._cache_kernels import compiled
from sextant.localization.observation.cached_local_gp import CachedLocalGP

MAP_IMAGES = 100_000_000
#: exact: every shard computes all its scores. index: a shard scores only the part selected by its vector index.
Proposal = Literal["exact", "index", "none"]
BATCHES = (1, 4, 16, 64)
#: Utilization above which a worker counts as overloaded.
OVERLOADED = 0.97
PARTICLES = 1000


@dataclass(frozen=True)
class Constants:
    """Constants measured on one core.

    Attributes:
        product_ns: time per map image of a product with b images, divided by b, for b of ``BATCHES``.
        passes_ns: time per map image of the passes after it: its mean's score, exponential and sum.
        particle_us: time to weight one particle anywhere in the map.
        bytes_an_image: descriptor, caches and search structures.
    """

    product_ns_1: float
    product_ns_4: float
    product_ns_16: float
    product_ns_64: float
    passes_ns: float
    particle_us: float
    bytes_an_image: float


@dataclass(frozen=True)
class Assumed:
    """Assumptions that are not measured here.

    Attributes:
        robots: number that localize at the same time.
        steps_hz: images per second of each robot.
        restarts_every: steps from one with requests to all shards to the next; others have local requests only.
        shards_touched: chances that the particles touch 1, 2 or 4 shards.
        particles: particles per robot.
        round_trip_ms: median of the network's; its logarithm has the standard deviation ``round_trip_spread``.
        fixed_ms: fixed time of any request.
        chance_spread: standard deviation of the logarithm of the factor on a busy time.
        stall_chance, stall_ms: probability and length of a delay by other causes.
        index_share: share of a shard's images that are scored exactly with an inverted index.
        parallel: speed-up of a node over one core in work on all its images: less than its cores, which share the
            memory bandwidth.
        local_workers: cores of a node that only weight particles and are not delayed by products with the map.
        most_together: largest number of requests per product.
        cores: cores per node.
        core_hour, gb_hour: prices, in any currency.
        deadline_ms: a step goes on without shards that have not answered.
        replica_down: share of time that a replica is unavailable.
    """

    robots: int = 500
    steps_hz: float = 2.0
    restarts_every: int = 10
    shards_touched: tuple[float, float, float] = (0.9, 0.08, 0.02)
    particles: int = PARTICLES
    round_trip_ms: float = 0.5
    round_trip_spread: float = 0.4
    fixed_ms: float = 0.1
    chance_spread: float = 0.15
    stall_chance: float = 0.001
    stall_ms: float = 20.0
    index_share: float = 0.02
    parallel: float = 8.0
    local_workers: int = 4
    most_together: int = 16
    cores: int = 16
    core_hour: float = 0.04
    gb_hour: float = 0.005
    deadline_ms: float = 500.0
    replica_down: float = 0.001


ASSUMED = Assumed()


@dataclass(frozen=True)
class Plan:
    """Numbers of shards and of nodes for each, and how restarts are proposed."""

    proposal: Proposal
    shards: int
    replicas: int


@dataclass(frozen=True)
class Outcome:
    """The result of a plan.

    Attributes:
        nodes: total number.
        gb_a_node: resident memory per node.
        busy: utilization of the busier kind of worker.
        per_hour: cost by the assumed prices.
        p50_ms, p99_ms: from a robot's request to the last answer, in steps with local requests only.
        restart_p50_ms, restart_p99_ms: in steps with requests to every shard; nan if there are none.
        complete: share of the steps in which every requested shard responded by the deadline.
        overloaded: requests arrive faster than they are processed: latencies are meaningless.
    """

    proposal: Proposal
    shards: int
    replicas: int
    nodes: int
    gb_a_node: float
    per_hour: float
    busy: float
    p50_ms: float
    p99_ms: float
    restart_p50_ms: float
    restart_p99_ms: float
    complete: float
    overloaded: bool


def plans() -> Iterator[Plan]:
    """The simulated plans."""
    for shards in (8, 32, 128):
        yield Plan("none", shards, 2)
    for shards in (8, 16, 32, 64, 128):
        for replicas in (1, 2):
            yield Plan("index", shards, replicas)
    for shards in (32, 64, 128, 256):
        for replicas in (1, 2, 3):
            yield Plan("exact", shards, replicas)


# -- what is measured --------------------------------------------------------------------------------------------------


def measure(model: CachedLocalGP) -> Constants:
    """Constants of one core of this machine, the fastest of many repeats, to exclude other load."""
    images = len(model.map)
    rows = model.map.descriptors.numpy()
    queries = rows[: max(BATCHES)].copy()
    transposed = rows.T

    def product(requests: int) -> object:
        return rows @ queries[0] if requests == 1 else queries[:requests] @ transposed

    products = [_quickest(partial(product, requests)) / requests for requests in BATCHES]
    evidence = model.observe(model.map.descriptors[:1].clone(), LIKELIHOOD)
    passes = _quickest(lambda: AppearanceProposal.of(evidence.over_map()))
    poses = model.map.poses[torch.linspace(0, images - 1, PARTICLES).long()][None]
    particles = _quickest(lambda: evidence.log_likelihood(poses))
    kept = sum(tensor.numel() * tensor.element_size() for tensor in model.state().values())
    searched = 120 * images
    stored = model.map.descriptors.numel() * 4 + model.map.poses.numel() * 8
    one, four, sixteen, sixty_four = (1e9 * seconds / images for seconds in products)
    return Constants(
        one, four, sixteen, sixty_four, 1e9 * passes / images, 1e6 * particles / PARTICLES,
        (kept + searched + stored) / images,
    )  # fmt: skip


def _quickest(work: Callable[[], object], repeats: int = 25) -> float:
    seconds = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - began)
    return min(seconds[1:])


# -- what is simulated -------------------------------------------------------------------------------------------------


def simulate(
    plan: Plan, constants: Constants, assumed: Assumed = ASSUMED, steps: int = 20_000, seed: int = 0
) -> Outcome:
    """Some steps of all robots together."""
    random = np.random.default_rng(seed)
    rate = assumed.robots * assumed.steps_hz
    arrives = 1e3 * np.cumsum(random.exponential(1 / rate, steps))  # ms
    restarts = (np.arange(steps) % assumed.restarts_every == 0) & (plan.proposal != "none")
    touched = np.minimum(random.choice([1, 2, 4], steps, p=assumed.shards_touched), plan.shards)
    first = random.integers(0, plan.shards, steps)

    done = arrives.copy()
    complete = np.ones(steps, bool)
    busy = np.zeros((plan.shards, 2))
    for shard in range(plan.shards):
        local = (shard - first) % plan.shards < touched
        asked = np.flatnonzero(local | restarts)
        down = random.random(len(asked)) < assumed.replica_down**plan.replicas
        complete[asked[down]] = False
        asked = asked[~down]
        finished, worked = _shard(plan, constants, assumed, arrives[asked], local[asked], restarts[asked], random)
        late = finished - arrives[asked] > assumed.deadline_ms
        complete[asked[late]] = False
        finished = np.minimum(finished, arrives[asked] + assumed.deadline_ms)
        done[asked] = np.maximum(done[asked], finished)
        busy[shard] = worked / arrives[-1]
    latency = done - arrives
    gigabytes = constants.bytes_an_image * MAP_IMAGES / plan.shards / 1e9
    p50, p99 = np.percentile(latency[~restarts], [50, 99])
    global_p50, global_p99 = np.percentile(latency[restarts], [50, 99]) if restarts.any() else (np.nan, np.nan)
    nodes = plan.shards * plan.replicas
    return Outcome(
        proposal=plan.proposal,
        shards=plan.shards,
        replicas=plan.replicas,
        nodes=nodes,
        gb_a_node=gigabytes,
        per_hour=nodes * (assumed.cores * assumed.core_hour + gigabytes * assumed.gb_hour),
        busy=float(busy.mean(0).max()),
        p50_ms=float(p50),
        p99_ms=float(p99),
        restart_p50_ms=float(global_p50),
        restart_p99_ms=float(global_p99),
        complete=float(complete.mean()),
        overloaded=bool((busy > OVERLOADED).any()),
    )


def _shard(
    plan: Plan,
    constants: Constants,
    assumed: Assumed,
    arrives: Float64[ndarray, " q"],
    local: ndarray,
    restarts: ndarray,
    random: np.random.Generator,
) -> tuple[Float64[ndarray, " q"], Float64[ndarray, "2"]]:
    """The time of each response, and the busy times of the workers for particles and for the map."""
    count = len(arrives)
    trip = assumed.round_trip_ms * np.exp(assumed.round_trip_spread * random.normal(size=(count)))
    chance = np.exp(assumed.chance_spread * random.normal(size=count))
    stalled = assumed.stall_ms * (random.random(count) < assumed.stall_chance)
    images = MAP_IMAGES / plan.shards * (assumed.index_share if plan.proposal == "index" else 1.0)
    together = np.arange(1, assumed.most_together + 1)
    product = np.interp(together, BATCHES, _products(constants)) * images * 1e-6 / assumed.parallel
    passes = constants.passes_ns * images * 1e-6 / assumed.parallel
    weighing = local * assumed.particles * constants.particle_us * 1e-3 + assumed.fixed_ms
    reached = arrives + trip / 2
    order = np.argsort(reached)
    finished = np.empty(count)
    worked = np.zeros(2)
    for kind, (rows, workers) in enumerate(((~restarts, assumed.local_workers), (restarts, 1))):
        some = order[rows[order]]
        if len(some):
            ends, worked[kind] = _serve(
                reached[some], weighing[some], restarts[some], chance[some], stalled[some], product, passes,
                plan.replicas * workers,
            )  # fmt: skip
            finished[some] = ends + trip[some] / 2
    return finished, worked / (plan.replicas * np.array([assumed.local_workers, 1]))


def _products(constants: Constants) -> list[float]:
    return [getattr(constants, f"product_ns_{b}") for b in BATCHES]


@compiled
def _serve(reached, weighing, restarts, chance, stalled, product, passes, workers):  # type: ignore[no-untyped-def]
    """First come, first served; a free worker takes all waiting requests at once, up to the limit."""
    free = np.zeros(workers)
    ends = np.empty(len(reached))
    worked = 0.0
    start = 0
    while start < len(reached):
        worker = np.argmin(free)
        begin = max(free[worker], reached[start])
        stop = start + 1
        while stop < len(reached) and stop - start < len(product) and reached[stop] <= begin:
            stop += 1
        needed = 0.0
        asking = 0
        for request in range(start, stop):
            needed += weighing[request] + stalled[request]
            if restarts[request]:
                asking += 1
        if asking:
            needed += asking * (product[asking - 1] + passes)
        needed *= chance[start]
        for request in range(start, stop):
            ends[request] = begin + needed
        free[worker] = begin + needed
        worked += needed
        start = stop
    return ends, worked
