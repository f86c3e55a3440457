from itertools import chain

import numpy as np
import pytest
import pytorch_lightning as pl
import torch

from sextant.data.batches import EpochBatches
from sextant.data.datamodule import ImageData
from sextant.data.source import ImageSource, ImageSpec, LabelledImages

TRAIN, TEST = 50, 9


class Numbered(ImageSource):
    """Training images 0 to 49 and test images 200 to 208, each filled with its number; labels are the last digit."""

    name = "numbered"

    def __init__(self):
        self.reads = []

    def files(self, split):
        return []

    def spec(self):
        return ImageSpec(1, 4, 4, tuple("0123456789"))

    def read(self, split):
        self.reads.append(split)
        numbers = np.arange(TRAIN) if split == "train" else np.arange(200, 200 + TEST)
        images = np.broadcast_to(numbers.astype(np.uint8)[:, None, None, None], (len(numbers), 1, 4, 4))
        return LabelledImages(images.copy(), numbers % 10)


def data(seed=0, split_seed=0, stages=("fit", "test")):
    options = {"batch_size": 8, "eval_batch_size": 4, "validation_fraction": 0.2}
    module = ImageData(Numbered(), **options, split_seed=split_seed, seed=seed)
    for stage in stages:
        module.setup(stage)
    return module


def numbers(loader):
    batches = list(loader)
    for batch in batches:
        assert torch.equal(batch.images[:, 0, 0, 0] % 10, batch.labels)
    return [batch.images[:, 0, 0, 0].tolist() for batch in batches]


def test_training_and_validation_share_out_the_training_images():
    module = data()
    train, validation = (
        list(chain(*numbers(loader))) for loader in (module.train_dataloader(), module.val_dataloader())
    )
    assert sorted(train + validation) == list(range(TRAIN))
    assert len(validation) == TRAIN / 5


def test_validation_and_test_batches_come_in_order():
    module = data()
    assert numbers(module.test_dataloader()) == [[200, 201, 202, 203], [204, 205, 206, 207], [208]]
    validation = list(chain(*numbers(module.val_dataloader())))
    assert validation == sorted(validation)


def test_runs_of_other_seeds_have_the_same_splits_in_another_order():
    first, second = data(seed=0), data(seed=1)
    assert torch.equal(first.split("validation").images, second.split("validation").images)
    assert torch.equal(first.split("train").images, second.split("train").images)
    assert numbers(first.train_dataloader()) != numbers(second.train_dataloader())


def test_another_split_seed_holds_out_other_images():
    first, second = data(split_seed=0), data(split_seed=1)
    assert not torch.equal(first.split("validation").images, second.split("validation").images)


@pytest.mark.parametrize(("stages", "reads"), [(["fit"], ["train"]), (["test"], ["test"]), (["fit", "fit"], ["train"])])
def test_a_stage_reads_what_it_needs_once(stages, reads):
    assert data(stages=stages).source.reads == reads


def test_indices_are_positions_in_the_split():
    module = data()
    for batch in module.train_dataloader():
        assert torch.equal(module.split("train").images[batch.indices], batch.images)


class Witness(pl.LightningModule):
    """Learns nothing and notes the images it is shown."""

    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.zeros(1))
        self.seen = {}

    def training_step(self, batch, _):
        self.seen.setdefault(self.current_epoch, []).append(batch.indices.tolist())
        return self.weight.sum()

    def validation_step(self, *_):
        pass

    def configure_optimizers(self):
        return torch.optim.SGD(self.parameters(), lr=0.1)


def fitted(epochs, checkpoint=None):
    """A trainer and the images that it showed, by epoch."""
    quiet = {
        "logger": False,
        "enable_checkpointing": False,
        "enable_progress_bar": False,
        "enable_model_summary": False,
    }
    trainer, witness = pl.Trainer(max_epochs=epochs, accelerator="cpu", **quiet), Witness()
    trainer.fit(witness, data(seed=5, stages=[]), ckpt_path=checkpoint)
    return trainer, witness.seen


def test_the_trainer_shows_each_epoch_in_the_order_of_its_seed_and_number():
    _, seen = fitted(3)
    assert list(seen) == [0, 1, 2]
    expected = EpochBatches(TRAIN * 4 // 5, 8, seed=5)
    for epoch, shown in seen.items():
        expected.set_epoch(epoch)
        assert shown == [batch.tolist() for batch in expected]


def test_a_resumed_trainer_shows_the_epochs_that_were_left(tmp_path):
    _, whole = fitted(3)
    first, _ = fitted(1)
    first.save_checkpoint(tmp_path / "first.ckpt")
    assert fitted(3, tmp_path / "first.ckpt")[1] == {1: whole[1], 2: whole[2]}
