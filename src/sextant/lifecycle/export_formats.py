"""Networks as files in the formats of other programs, compared with the original network."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from sextant.applications.write_errors import telling_write_errors
from sextant.errors import UserError, naming_extras
from sextant.kit.offers import Exportable

Format = Literal["onnx", "torch_export"]

FILES: Mapping[Format, str] = {"onnx": "network.onnx", "torch_export": "network.pt2"}
#: largest accepted difference from the network's output, relative to its largest number or to 1
TOLERANCE = 1e-4
#: sizes of the compared batches, which differ from that of the traced batch
BATCHES = (1, 3)
BATCH_AXIS = "batch"
Answer = Callable[[Mapping[str, Tensor]], Sequence[Tensor]]


@torch.no_grad()
def write_network(found: Exportable, form: Format, path: Path) -> float:
    """Write a network to a file, and compare the outputs of both.

    Args:
        found: the network.
        form: format of the file.
        path: path of the file.

    Returns:
        The largest difference between outputs of the file and of the network on noise, relative to the largest output
        or to 1.

    Raises:
        UserError: the network cannot be traced, the file's outputs differ, it cannot be written, or needs an extra.
    """
    shapes = {name: {0: torch.export.Dim.DYNAMIC} for name in found.inputs}
    path.parent.mkdir(parents=True, exist_ok=True)
    written = path.with_name(f".{path.name}.tmp{path.suffix}")  # an earlier file is kept until this one has passed
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # exporters warn about their own internals
        try:
            program = torch.export.export(found.network, (), dict(found.inputs), dynamic_shapes=shapes)
            answer = _onnx(program, found, written) if form == "onnx" else _torch_export(program, written)
            parity = max(_difference(found, answer, batch) for batch in BATCHES)
        except (ModuleNotFoundError, OSError):  # an extra is not installed, or the disk is full
            written.unlink(missing_ok=True)
            with naming_extras(f"format={form}"), telling_write_errors(path.parent):
                raise
        except Exception as error:  # exporters and ONNX Runtime raise errors of any kind
            written.unlink(missing_ok=True)
            raise UserError(
                f"this network cannot be exported as {form}: {_first_line(error)}",
                "Its code depends on the values of its input, or uses operations that the format lacks.",
            ) from error
    if not parity <= TOLERANCE:
        written.unlink()
        raise UserError(
            f"the exported network's outputs differ from the original's by {parity:.2g} of the largest output",
            f"More than {TOLERANCE:g} is refused; the file is deleted.",
        )
    written.replace(path)
    return parity


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


def _onnx(program: torch.export.ExportedProgram, found: Exportable, path: Path) -> Answer:
    made = torch.onnx.export(
        program,
        kwargs=dict(found.inputs),
        input_names=list(found.inputs),
        output_names=found.outputs,
        dynamic_shapes={name: {0: BATCH_AXIS} for name in found.inputs},  # here it only gives the axis its name
        dynamo=True,
        external_data=False,
        verbose=False,
        custom_translation_table=_missing_operations(),
    )
    assert made is not None
    made.save(path)
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])

    def answer(inputs: Mapping[str, Tensor]) -> list[Tensor]:
        return [torch.from_numpy(value) for value in session.run(None, {k: v.numpy() for k, v in inputs.items()})]

    return answer


def _torch_export(program: torch.export.ExportedProgram, path: Path) -> Answer:
    torch.export.save(program, path)
    module = torch.export.load(path).module()
    return lambda inputs: _several(module(**inputs))


def _missing_operations() -> dict[Callable[..., Any], Callable[..., Any]]:
    """Translations of operations that PyTorch's exporter lacks."""
    from onnxscript import opset18

    op: Any = opset18

    def hypot(x: Any, y: Any) -> Any:
        return op.Sqrt(op.Add(op.Mul(x, x), op.Mul(y, y)))

    def signbit(x: Any) -> Any:
        return op.Less(x, op.CastLike(op.Constant(value_float=0.0), x))

    return {torch.ops.prims.hypot.default: hypot, torch.ops.prims.signbit.default: signbit}


def _difference(found: Exportable, answer: Answer, batch: int) -> float:
    generator = torch.Generator().manual_seed(batch)
    inputs = {
        name: example.min()
        + (example.max() - example.min()) * torch.rand((batch, *example.shape[1:]), generator=generator)
        for name, example in found.inputs.items()
    }
    worst = 0.0
    for ours, theirs in zip(_several(found.network(**inputs)), answer(inputs), strict=True):
        if ours.shape != theirs.shape:
            return float("inf")
        apart = torch.where(ours == theirs, 0.0, (ours - theirs).abs())  # equal infinities count as equal
        if not apart.isfinite().all():  # max may ignore a nan
            return float("inf")
        worst = max(worst, float(apart.max() / torch.where(ours.isfinite(), ours, 0.0).abs().max().clamp(min=1.0)))
    return worst


def _several(outputs: Any) -> Sequence[Tensor]:
    return outputs if isinstance(outputs, tuple | list) else (outputs,)
