"""Training steps per second on the CPU in bfloat16 and with ``torch.compile``, against plain float32."""

from benchmarks import gpu


def run() -> list[tuple[str, str, str, str, str]]:
    """A row for each network, precision and compilation."""
    return [
        (f"{name}, {how}", measured, against, ratio, "")
        for name, how, measured, against, ratio in gpu.run("cpu", precisions=("32", "bf16"))
        if how != "32"
    ]
