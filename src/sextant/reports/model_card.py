"""Model cards, pages that describe trained models."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sextant.reports.metric import seeds_interval
from sextant.reports.run_comparison import metrics_alike
from sextant.runs.directory import RunDirectory
from sextant.tables import NOTHING, TextTable, decimals, interval, number

LICENCE = (
    "The code is Sextant's (MIT). The weights carry no licence of their own: they are whoever's trained them, on the "
    "data above and under its terms."
)
NO_CARD: Mapping[str, Any] = MappingProxyType({})
#: groups of the config that a card lists first
PARTS = ("dataset", "backbone", "inhibition", "loss", "pooling", "parameterization", "bank", "strategy", "corruption")


def model_card(
    title: str,
    uses: Sequence[tuple[str, str]],
    content: Mapping[str, Any],
    run: RunDirectory | None,
    outputs: Path,
    notes: Sequence[str] = (),
    card: Mapping[str, Any] = NO_CARD,
) -> str:
    """A model card, as Markdown.

    Args:
        title: title of the page.
        uses: names and descriptions of inputs and outputs.
        content: the checkpoint's metadata: task, config and spec.
        run: its directory, the source of data, metrics and versions; None for a checkpoint that lies elsewhere.
        outputs: folder of runs; intervals are computed from other seeds of the same config there.
        notes: notes to put first.
        card: card of a model that comes with the package and has no run.
    """
    state = {} if run is None else run.state()
    raw = content["config"]
    chosen = {part: str((raw.get(part) or {}).get("_target_", "")).rpartition(".")[2] for part in PARTS}
    facts = {
        "task": content["task"],
        **{part: name for part, name in chosen.items() if name},
        "seed": raw.get("seed", NOTHING),
        "epochs": (raw.get("trainer") or {}).get("max_epochs", NOTHING),
        **_origin(state),
    }
    parts = [
        f"# {title}\n",
        *(f"{note}\n" for note in notes),
        "## In and out\n",
        TextTable(["name", "what it is"], [[f"`{name}`", text] for name, text in uses]).markdown(),
        "## Training\n",
        TextTable(["", ""], [[name, str(value)] for name, value in facts.items()]).markdown(),
        "## Metrics\n",
        *_metrics(run, state, outputs, card),
        f"## Licence\n\n{card.get('licence', LICENCE)}\n",
    ]
    return "\n".join(parts)


def _origin(state: Mapping[str, Any]) -> dict[str, str]:
    found = {name: str(state[name])[:12] for name in ("digest", "data", "code") if name in state}
    origin = state.get("provenance") or {}
    if (origin.get("git") or {}).get("commit"):
        found["git commit"] = origin["git"]["commit"][:12] + (" with changes" if origin["git"].get("dirty") else "")
    found["versions"] = ", ".join(f"{name} {value}" for name, value in (origin.get("versions") or {}).items())
    found["hardware"] = ", ".join(f"{name} {value}" for name, value in (origin.get("hardware") or {}).items() if value)
    return {name: text for name, text in found.items() if text}


def _told_by(measured: Mapping[str, Any]) -> list[str]:
    """The measurements in the card of a packaged model: tables of test sets, and single values."""
    told = [": ".join([f"`{measured['command']}`", *filter(None, [measured.get("unit")])]) + ".\n"]
    values = list[list[str]]()
    for name, value in measured.items():
        if isinstance(value, list):
            told += [
                f"{name}:\n",
                TextTable(list(value[0]), [list(map(str, each.values())) for each in value]).markdown(),
            ]
        elif isinstance(value, Mapping):
            values += [[f"{name}, {key}", str(inner)] for key, inner in value.items()]
        elif name not in ("command", "unit"):
            values.append([name, str(value)])
    return told + ([TextTable(["", ""], values).markdown()] if values else [])


def _metrics(run: RunDirectory | None, state: Mapping[str, Any], outputs: Path, card: Mapping[str, Any]) -> list[str]:
    own = {} if run is None else (run.results() or {}).get("metrics") or {}
    own = {name: value for name, value in own.items() if isinstance(value, int | float)}
    if not own and card:
        return _told_by(card["metrics"])
    if not own:
        return ["Not known: the checkpoint lies outside of its run, or was not tested.\n"]
    alike = metrics_alike(state, outputs)
    rows = []
    for name, value in own.items():
        values = np.array([float(each[name]) for each in alike if name in each])
        digits = decimals(value, 4)
        told = interval(*seeds_interval(name, values), digits) if len(values) > 1 else NOTHING
        mean = number(float(values.mean()), digits) if len(values) > 1 else NOTHING
        rows.append([f"`{name}`", number(value, digits), mean, told])
    others = f"of {len(alike)} runs that differ in their seeds" if len(alike) > 1 else "unknown: no other seeds here"
    return [
        f"Of this model; mean and 95 % interval over seeds are {others}.\n",
        TextTable(["metric", "this model", "mean over seeds", "95 % of the mean"], rows).markdown(),
    ]
