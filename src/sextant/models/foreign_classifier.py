"""Classifiers of others: networks of timm, and files of RobustBench for CIFAR, with their preprocessing.

A file is read as tensors and plain containers; nothing in it is executed. Its kind, depth, width and classes follow
from names and shapes. The standardisation of a RobustBench network is in its file (``mu``, ``sigma``) or in the code of
the zoo, by the name of the file that RobustBench saves: ``<model>.pt``. Ensembles, and networks whose activations or
blocks are of other kinds, are refused.

Sources: RobustBench, ``robustbench/utils.py``, ``model_zoo/cifar10.py`` and ``model_zoo/cifar100.py``; timm, "Model
configs": ``input_size``, ``crop_pct``, ``mean`` and ``std`` of ``pretrained_cfg``, and the ``config.json`` that lies
beside its files.
"""

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, PositiveFloat, PositiveInt, ValidationError
from torch import Tensor

from sextant.atomic_files import read_json
from sextant.errors import UserError, how_to_install
from sextant.models.published_arrays import number_of
from sextant.models.weights_file import read_weights
from sextant.torch_file import require_finite

SOURCES = ("timm:", "robustbench:")
USAGE = "Give model=timm:<name or file> or model=robustbench:<file>."
UNIT, HALF = ((0.0,) * 3, (1.0,) * 3), ((0.5,) * 3, (0.5,) * 3)
CIFAR = ((0.4914, 0.4822, 0.4465), (0.2471, 0.2435, 0.2616))
#: means and deviations of the zoo's networks, by the name of their file
STANDARDISED: Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]] = {
    **dict.fromkeys(("Hendrycks2020AugMix_WRN", "Hendrycks2020AugMix_ResNeXt", "Hendrycks2019Using"), HALF),
    **dict.fromkeys(("Rice2020Overfitting", "Chen2020Efficient"), CIFAR),
    "Rony2019Decoupling": ((0.491, 0.482, 0.447), (0.247, 0.243, 0.262)),
    **dict.fromkeys(
        (
            *("Standard", "Carmon2019Unlabeled", "Sehwag2020Hydra", "Wang2020Improving", "Zhang2019Theoretically"),
            *("Huang2020Self", "Zhang2019You", "Zhang2020Attacks", "Wu2020Adversarial", "Wu2020Adversarial_extra"),
            *("Sehwag2021Proxy", "Sehwag2021Proxy_R18", "Sitawarin2020Improving", "Zhang2020Geometry"),
            *("Cui2020Learnable_34_10", "Cui2020Learnable_34_20", "Sridhar2021Robust", "Sridhar2021Robust_34_15"),
            *("Addepalli2021Towards_RN18", "Addepalli2021Towards_WRN34", "Addepalli2022Efficient_RN18"),
            *("Addepalli2022Efficient_WRN_34_10", "Chen2021LTD_WRN34_10", "Chen2021LTD_WRN34_20"),
            *("Jia2022LAS-AT_34_10", "Jia2022LAS-AT_70_16"),
        ),
        UNIT,
    ),
}
#: entries of files that the networks do not use
UNUSED = re.compile(r"^(mu|sigma|sub_block1\..*)$")


@dataclass(frozen=True)
class ForeignClassifier:
    """A classifier of others.

    Attributes:
        reference: what the user wrote.
        backbone: config node that builds the network, without weights; ``mean`` and ``std`` are None if unknown.
        classes: number of logits.
        state: weights by the names in the network that the node builds.
        size: side of its square images; None if any size is right.
        crop: share of an image's shorter side that its preprocessing keeps.
    """

    reference: str
    backbone: dict[str, Any]
    classes: int
    state: Mapping[str, Tensor] = field(repr=False)
    size: int | None = None
    crop: float | None = None

    @property
    def identity(self) -> str:
        """Hash of the names and values of the weights."""
        digest = hashlib.sha256()
        for name, tensor in sorted(self.state.items()):
            digest.update(f"{name} {tuple(tensor.shape)} {tensor.dtype} ".encode())
            digest.update(tensor.detach().cpu().contiguous().numpy().tobytes())
        return digest.hexdigest()

    def card(self) -> str:
        """Kind, size, standardisation and hash, in one line."""
        about = {key: value for key, value in self.backbone.items() if key != "_target_" and value is not None}
        told = ", ".join(f"{key} {value}" for key, value in about.items())
        size = "" if self.size is None else f", {self.size}x{self.size}"
        return f"{self.reference}: {told}{size}, {self.classes} classes, SHA-256 {self.identity[:12]}; not of Sextant"


def read_foreign(reference: str) -> ForeignClassifier:
    """Read the classifier that ``timm:<name or file>`` or ``robustbench:<file>`` names.

    Raises:
        UserError: timm is not installed or has no such network, its weights cannot be fetched, or the file is missing,
            holds more than tensors, or is a network of another kind.
    """
    if reference.startswith("timm:"):
        return _timm(reference, reference.removeprefix("timm:"))
    if reference.startswith("robustbench:"):
        return _robustbench(reference, Path(reference.removeprefix("robustbench:")).expanduser())
    raise UserError(f"model={reference}: no such source", USAGE)


def _timm(reference: str, given: str) -> ForeignClassifier:
    try:
        import timm
    except ImportError:
        raise UserError(f"model={reference} needs the package timm", how_to_install("timm")) from None
    path = Path(given).expanduser()
    if path.is_file():
        name, config = _timm_config(reference, path)
        state = _tensors(path)
    else:
        if not timm.is_model(given):
            near = timm.list_models(f"{given[:6]}*")[:5] or timm.list_models("resnet1*")[:5]
            raise UserError(
                f"model={reference}: there is no such network or file", f"For example timm:{', '.join(near)}"
            )
        name = given
        try:
            network: Any = timm.create_model(name, pretrained=True)
        except (OSError, RuntimeError) as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise UserError(
                f"model={reference}: its weights could not be fetched: {reason}",
                f"Give a file of them that is named after the network: model=timm:<folder>/{name}.safetensors",
            ) from None
        state, config = network.state_dict(), _preprocessing(f"model={reference}", network.pretrained_cfg)
    head = config.classifier if isinstance(config.classifier, str) else config.classifier[0]
    if (weight := state.get(f"{head}.weight")) is None:
        raise UserError(
            f"model={reference}: the file has no {head}.weight, so it is not {name} with a classifier", USAGE
        )
    return ForeignClassifier(
        reference,
        {
            "_target_": "sextant.models.TimmClassifier",
            "name": name,
            "mean": list(config.mean),
            "std": list(config.std),
        },
        len(weight),
        {f"network.{key}": value for key, value in state.items()},
        config.input_size[-1],
        config.crop_pct or 1.0,
    )


class _Preprocessing(BaseModel):
    """What a network of timm says about its images and its head."""

    model_config = ConfigDict(allow_inf_nan=False)

    mean: tuple[float, float, float]
    std: tuple[PositiveFloat, PositiveFloat, PositiveFloat]
    input_size: tuple[PositiveInt, PositiveInt, PositiveInt]
    classifier: str | Annotated[tuple[str, ...], Field(min_length=1)]
    crop_pct: PositiveFloat | None = None


def _timm_config(reference: str, path: Path) -> tuple[str, _Preprocessing]:
    """Name and preprocessing of a file's network: by the config beside it, or by the file's own name."""
    import timm

    beside = path.with_name("config.json")
    stored: Any = read_json(beside) if beside.is_file() else {}
    own = stored.get("pretrained_cfg", {}) if isinstance(stored, Mapping) else None
    if not isinstance(own, Mapping):
        what = "its pretrained_cfg" if isinstance(stored, Mapping) else "it"
        raise UserError(
            f"{beside} is not a config of timm: {what} must be a mapping",
            f"Remove it if {path.name} is named after its network, or copy it again.",
        )
    name, tag = _timm_name(reference, path, stored)
    tag = str(own.get("tag") or tag)
    try:
        known = timm.get_pretrained_cfg(f"{name}.{tag}" if tag else name, allow_unregistered=True)
    except RuntimeError:  # no such tag
        if not {"mean", "std", "input_size", "classifier"} <= own.keys():
            tags = [each.partition(".")[2] for each in timm.list_pretrained(f"{name}.*")]
            raise UserError(
                f"model={reference}: timm has no weights {tag} of {name}, so their preprocessing is not known",
                f"Name the file {name}.<tag>{path.suffix} after its weights; tags: {', '.join(tags) or 'none'}.",
            ) from None
        known = None
    where = str(beside if beside.is_file() else path)
    return name, _preprocessing(where, {**(known.to_dict() if known else {}), **own})


def _preprocessing(where: str, values: Mapping[str, Any]) -> _Preprocessing:
    try:
        return _Preprocessing.model_validate({**values})
    except ValidationError as error:
        wrong = ", ".join(dict.fromkeys(str(each["loc"][0]) for each in error.errors()))
        raise UserError(
            f"{where}: missing or malformed in the pretrained_cfg of timm: {wrong}",
            "Expected: mean, std and input_size of three numbers, and classifier, the name of the last layer.",
        ) from None


def _timm_name(reference: str, path: Path, stored: Mapping[str, Any]) -> tuple[str, str]:
    """Name and tag: by the config beside a file, or by its own name: the longest that it begins with, dot, tag."""
    import timm

    stem, _, tag = re.sub(r"(\.(safetensors|pth|pt|th|bin|ckpt|tar))+$", "", path.name).partition(".")
    names = [stem[:n] for n in range(len(stem), 0, -1)]
    if stored:
        stem, _, tag = str(stored.get("architecture", "")).partition(".")
        names = [stem]
    found = next((name for name in names if timm.is_model(name)), None)
    if found is None:
        raise UserError(
            f"model={reference}: neither {path.name} nor a config.json beside it names a network of timm",
            "Name the file after its network, such as resnet18.safetensors.",
        )
    return found, tag


def _robustbench(reference: str, path: Path) -> ForeignClassifier:
    state = _tensors(path)
    backbone, classes = _kind(reference, state)
    mean, std = STANDARDISED.get(path.name.partition(".")[0], (None, None))
    if "mu" in state and "sigma" in state:
        mean, std = (tuple(float(value) for value in state[key].flatten()) for key in ("mu", "sigma"))
    backbone |= {key: None if value is None else list(value) for key, value in (("mean", mean), ("std", std))}
    own = {name: tensor for name, tensor in state.items() if not UNUSED.match(name)}
    return ForeignClassifier(reference, {"_target_": "sextant.models.robustbench_net", **backbone}, classes, own)


def _kind(reference: str, state: Mapping[str, Tensor]) -> tuple[dict[str, Any], int]:
    """The arguments of the network whose weights these are, and its number of classes."""
    try:
        if "block1.layer.0.conv1.weight" in state:
            blocks = number_of(state, r"block1\.layer\.\d+\.conv1\.weight")
            width, classes = len(state["block1.layer.0.conv1.weight"]) // 16, len(state["fc.weight"])
            return {"kind": "wide_resnet", "depth": 6 * blocks + 4, "width": width}, classes
        if "stage_1.0.conv_conv.weight" in state:
            blocks, grouped = number_of(state, r"stage_1\.\d+\.conv_conv\.weight"), state["stage_1.0.conv_conv.weight"]
            width, groups = grouped.shape[1], len(grouped) // grouped.shape[1]
            found = {"kind": "resnext", "depth": 9 * blocks + 2, "width": width, "groups": groups}
            return found, len(state["classifier.weight"])
        if "layer4.1.conv2.weight" in state and "bn1.weight" in state and "layer1.0.conv3.weight" not in state:
            return {"kind": "resnet18", "depth": 18, "width": 1}, len(state["linear.weight"])
        first = ", ".join(list(state)[:3])
    except (KeyError, IndexError) as error:
        first = f"no {error}"
    raise UserError(
        f"model={reference}: neither a Wide ResNet, a ResNeXt nor a ResNet-18 in RobustBench's layout; it has {first}",
        "Other kinds of its networks are not supported.",
    )


def _tensors(path: Path) -> dict[str, Tensor]:
    """The state dict in a file, without the prefixes of wrappers."""
    content = read_weights(path, f"model={path}", USAGE)
    for key in ("state_dict", "model", "net"):
        if isinstance(content, Mapping) and isinstance(content.get(key), Mapping):
            content = content[key]
            break
    if not isinstance(content, Mapping) or not content or not all(isinstance(v, Tensor) for v in content.values()):
        raise UserError(f"model={path} is not a state dict: a mapping of tensors by name is expected", USAGE)
    require_finite(content, path)
    return {re.sub(r"^(module\.|model\.)+", "", str(name)): tensor for name, tensor in content.items()}
