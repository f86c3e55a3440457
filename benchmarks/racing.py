"""Racing against full seeds: 200 simulated searches, in which the best trial is known.

``python -m benchmarks.racing``   runs saved and regret of the chosen trial, by the spread between seeds

A search has 30 trials of 5 seeds. True accuracies are drawn from Beta(5, 2); a seed adds a shared effect to
all trials (standard deviation 0.03) and an own effect to each, whose spread differs between trials by up to four times.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from rich.console import Console
from rich.table import Table

from sextant.evaluation.racing import every, leader, racing, seeds_run

SEARCHES, TRIALS, SEEDS = 200, 30, 5
#: spread between seeds, and number of images of an accuracy
CASES = ((0.005, None), (0.02, None), (0.05, None), (0.01, 143))
Rule = Callable[[np.ndarray], list[int]]


def drawn(
    seed: int, trials: int = TRIALS, seeds: int = SEEDS, spread: float = 0.02, images: int | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """True means of trials, and their scores at each seed: accuracies on ``images`` images, or on infinitely many."""
    random = np.random.default_rng(seed)
    means = random.beta(5, 2, trials)
    shared = random.normal(0, 0.03, seeds)
    noise = random.normal(0, 1, (trials, seeds)) * spread * random.uniform(0.5, 2, (trials, 1))
    scores = means[:, None] + shared + noise
    return means, scores if images is None else np.round(images * scores.clip(0, 1)) / images


def search(scores: np.ndarray, rule: Rule) -> np.ndarray:
    """The scores that are evaluated when trials arrive one by one; nan elsewhere."""
    seen = np.full((0, scores.shape[1]), np.nan)
    for _ in scores:
        seen = fill(np.vstack([seen, np.full(scores.shape[1], np.nan)]), scores, rule)
    return seen


def raced(scores: np.ndarray, confidence: float = 0.95) -> np.ndarray:
    """The scores that a race evaluates: the best trial gets all seeds at the end."""
    rule = partial(racing, confidence=confidence)
    return fill(search(scores, rule), scores, partial(rule, last=True))


def fill(seen: np.ndarray, scores: np.ndarray, rule: Rule) -> np.ndarray:
    """Run all trials that the rule continues, until there are none."""
    while deserving := rule(seen):
        for trial in deserving:
            place = seeds_run(seen)[trial]
            seen[trial, place] = scores[trial, place]
    return seen


def simulated(
    spread: float, images: int | None = None, confidence: float = 0.95, searches: int = SEARCHES
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Share of runs saved, and regret with racing and with all seeds, of each search."""
    rows = []
    for number in range(searches):
        means, scores = drawn(number, spread=spread, images=images)
        seen, full = raced(scores, confidence), search(scores, every)
        rows.append([np.isnan(seen).mean(), *(means.max() - means[leader(found)] for found in (seen, full))])
    saved, with_racing, with_all = np.array(rows).T
    return saved, with_racing, with_all


def main() -> None:
    table = Table("a seed makes", "images", "runs saved", "regret, racing", "regret, all seeds", "same winner")
    for spread, images in CASES:
        saved, with_racing, with_all = simulated(spread, images)
        numbers = (f"{with_racing.mean():.5f}", f"{with_all.mean():.5f}", f"{np.mean(with_racing == with_all):.1%}")
        table.add_row(f"{spread}", f"{images or 'endless'}", f"{saved.mean():.1%}", *numbers)
    Console(width=110).print(table)


if __name__ == "__main__":
    main()
