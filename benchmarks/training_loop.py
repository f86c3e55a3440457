"""A whole run's training against a plain PyTorch loop over the same batches in the same order, on MNIST or digits."""

import os
import statistics
import tempfile
import time
from pathlib import Path

import torch
import torch.nn.functional as F

EPOCHS = 3
REPEATS = 3


def run() -> list[tuple[str, str, str, str, str]]:
    from sextant.composing.compose import compose, to_plain
    from sextant.tracking.environment import quiet_libraries

    quiet_libraries()
    dataset = "mnist" if "SEXTANT_DATA" in os.environ else "digits"
    ours, plain, push_pull = [], [], []
    for _ in range(REPEATS):  # in turn, so that changes of the machine's speed affect both
        with tempfile.TemporaryDirectory() as outputs:
            overrides = [f"dataset={dataset}", f"trainer.max_epochs={EPOCHS}", f"paths.outputs={outputs}"]
            raw = to_plain(compose(["experiment=lenet_mnist", *overrides, "trainer.progress=false"]))
            ours.append(_ours(raw))
            plain.append(_plain(raw))
            push_pull.append(_ours({**raw, "inhibition": to_plain(compose(["inhibition=push_pull"]))["inhibition"]}))
    ratio = statistics.median(o / p for o, p in zip(ours, plain, strict=True))
    measured, against = statistics.median(ours), statistics.median(plain)
    name = f"LeNet-A, {dataset}, {EPOCHS} epochs, with tracking"
    cost = statistics.median(p / o for p, o in zip(push_pull, ours, strict=True))
    layer = f"{statistics.median(push_pull):.2f} s"
    return [
        (name, f"{measured:.2f} s", f"plain PyTorch loop {against:.2f} s", f"{ratio:.3f}", "<= 1.15"),
        ("the same with a push-pull first layer", layer, f"with the convolution {measured:.2f} s", f"{cost:.2f}", ""),
    ]


def _ours(raw: dict) -> float:
    from sextant.lifecycle.execute import execute
    from sextant.runs.directory import RunDirectory

    return RunDirectory(execute(raw).directory).results()["timing"]["fit_s"]


def _plain(raw: dict) -> float:
    """The essentials of ``fit``: read the data, train, validate once per epoch."""
    from sextant.config import validate
    from sextant.config.building import build
    from sextant.registry import chapter_of

    config = validate(raw)
    family = chapter_of(config.task.name)
    source = family.source(config)
    began = time.monotonic()
    torch.manual_seed(config.seed)
    data = family.data(config, source)
    data.setup("fit")
    spec = source.spec()
    network = build(
        raw, "backbone", in_channels=spec.channels, image_size=(spec.height, spec.width), num_classes=len(spec.classes)
    )
    optimizer, schedule = build(raw, "optimizer")(network.parameters()), build(raw, "schedule")
    rates = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda epoch: schedule(epoch / EPOCHS))
    train, validation = data.split("train"), data.split("validation")
    for epoch in range(EPOCHS):
        generator = torch.Generator().manual_seed(config.seed * 1_000_003 + epoch)
        for chosen in torch.randperm(len(train), generator=generator).split(config.trainer.batch_size):
            loss = F.cross_entropy(network(train.images[chosen].float() / 255), train.labels[chosen])
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
        rates.step()
        with torch.no_grad():
            for images in validation.images.split(config.trainer.eval_batch_size):
                network(images.float() / 255)
    return time.monotonic() - began


if __name__ == "__main__":
    print(Path(__file__).name, *run())
