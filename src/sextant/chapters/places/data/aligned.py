"""Traverses whose frames correspond, by equal names or by their order."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sextant.data.image_files import natural_key
from sextant.data.photo_files import images_below
from sextant.data.source import MissingDataError
from sextant.errors import ArgumentError, problem_list
from sextant.tables import counted
from sextant.user_files import absent


@dataclass(frozen=True)
class AlignedRides:
    """Files by traverse, each with the number of its frame.

    Attributes:
        files: path by frame number, for each traverse.
        count: number of frames, including those that a traverse lacks.
        missing: frames that a traverse lacks: their numbers, and ``traverse/name``.
    """

    files: Mapping[str, Mapping[int, Path]]
    count: int
    missing: tuple[tuple[int, str], ...] = ()


def traverse_files(traverses: Mapping[str, Path], key: str) -> dict[str, list[Path]]:
    """The images of each traverse's folder in the natural order of their names.

    Args:
        traverses: folder by name.
        key: the argument that named them, for messages: ``test``; empty if each traverse is an argument of its own.

    Raises:
        MissingDataError: a folder does not exist, or has no images.
        UserError: two traverses have the same folder, or one folder lies in the other.
    """
    resolved = {name: folder.resolve() for name, folder in traverses.items()}
    within = f"{key}." if key else ""
    for name, folder in resolved.items():
        if not folder.is_dir():
            raise MissingDataError(
                f"{within}{name}={absent(traverses[name])}", f"Give a folder of images: {within}{name}=<folder>"
            )
        for other, around in resolved.items():
            if other != name and (folder == around or around in folder.parents):
                raise ArgumentError(
                    f"{within}{name}={traverses[name]} and {within}{other}={traverses[other]} have the same files",
                    "Each traverse needs its own folder.",
                )
    files = {name: images_below(folder) for name, folder in resolved.items()}
    for name, paths in files.items():
        if not paths:
            raise MissingDataError(
                f"{within}{name}={traverses[name]} holds no images",
                "Images are .jpg, .png, .tif, .webp, .bmp, .ppm, .avif.",
            )
    return files


def align_by_name(
    files: Mapping[str, Sequence[Path]], traverses: Mapping[str, Path], key: str, *, skip_missing: bool
) -> AlignedRides:
    """Align frames by name (without suffix): equal names are one place, numbered in the natural order of all names.

    Args:
        files: by traverse.
        traverses: folder of each; names are relative to it.
        key: of the config, for messages.
        skip_missing: let a traverse lack frames that another has; otherwise that is an error.

    Raises:
        UserError: a traverse lacks frames (the message names them), or has two of the same name.
    """
    named: dict[str, dict[str, Path]] = {}
    for name, paths in files.items():
        root, own = traverses[name].resolve(), dict[str, Path]()
        for path in paths:
            stem = path.relative_to(root).with_suffix("").as_posix()
            if stem in own:
                raise ArgumentError(
                    f"{key}: {name} has two frames of the same name: {own[stem].name} and {path.name}",
                    "Remove one of them.",
                )
            own[stem] = path
        named[name] = own
    stems = sorted(set().union(*named.values()), key=natural_key)
    missing = tuple(
        (i, f"{name}/{stem}") for name, own in named.items() for i, stem in enumerate(stems) if stem not in own
    )
    if missing and not skip_missing:
        counts = ", ".join(f"{name} {len(own):,}" for name, own in named.items())
        raise ArgumentError(
            f"{key}: equal names are equal places, and {counted(len(missing), 'frame lacks', 'frames lack')} a "
            f"partner ({counts} frames)\n{problem_list([name for _, name in missing])}",
            "Add them, or go on without (they are counted): skip_bad=true",
        )
    numbered = {name: {i: own[stem] for i, stem in enumerate(stems) if stem in own} for name, own in named.items()}
    return AlignedRides(numbered, len(stems), missing)


def align_by_order(files: Mapping[str, Sequence[Path]], key: str) -> AlignedRides:
    """Align frames by order: the i-th files of all traverses are one place.

    Raises:
        UserError: the traverses differ in length.
    """
    counts = {name: len(paths) for name, paths in files.items()}
    if len(set(counts.values())) > 1:
        listed = problem_list(
            [
                f"{name}: {counted(n, 'image')}, {files[name][0].name} to {files[name][-1].name}"
                for name, n in counts.items()
            ]
        )
        raise ArgumentError(
            f"{key}: places=order treats the i-th images of all traverses as one place, "
            f"but these differ in length\n{listed}",
            "Remove unpaired images, or align them by equal names (places=name) or by poses (places=csv or utm).",
        )
    return AlignedRides({name: dict(enumerate(paths)) for name, paths in files.items()}, max(counts.values()))
