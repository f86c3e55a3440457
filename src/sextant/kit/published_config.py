"""What the config of a published network has in common with any run's, whatever its task."""

from typing import Any

from sextant.runs.outputs_folder import default_outputs


def published_config(*, epochs: int, eval_batch_size: int, log_every: int, **own: Any) -> dict[str, Any]:
    """The config that builds a published network.

    The training settings are the task's defaults, not those of the authors.

    Args:
        epochs, eval_batch_size, log_every: of the task's defaults for ``trainer``.
        own: further groups.
    """
    outputs = str(default_outputs())
    return {
        "seed": 0,
        "init_from": None,
        "reuse": "exact",
        "corruption": {"_target_": "sextant.corruptions.CorruptionSuite", "corruptions": {}, "seed": 0},
        "inhibition": {"_target_": "sextant.layers.NoInhibition"},
        "trainer": {
            "accelerator": "cpu",
            "devices": 1,
            "precision": "32-true",
            "deterministic": True,
            "threads": 1,
            "max_epochs": epochs,
            "batch_size": 32,
            "eval_batch_size": eval_batch_size,
            "log_every": log_every,
            "workers": 0,
            "progress": True,
        },
        "tracking": {
            "kind": "sqlite",
            "uri": None,
            "experiment": None,
            "system_metrics": True,
            "system_metrics_every_s": 10,
            "log_checkpoint": False,
            "parent_run": None,
        },
        "paths": {"data": f"{outputs}/data", "outputs": outputs, "cache": f"{outputs}/data"},
        **own,
    }
