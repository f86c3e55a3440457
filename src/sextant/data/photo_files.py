"""Find the images below a folder, or those that a path or pattern names; imports no torch.

Datasets, predictions, maps and inspection all list folders by :func:`walk_folder`.
"""

import glob
import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from sextant.data.file_kinds import DEVELOP, NAMELESS, RAW, RENAME, SYSTEM, is_hidden, is_nameless_picture, not_decoded
from sextant.data.image_files import SUFFIXES, natural_key
from sextant.data.pixel_values import warn_once
from sextant.data.videos import VIDEOS
from sextant.errors import UserError, one_line, problem_list
from sextant.tables import counted
from sextant.user_files import absent


def nothing_usable(problem: str, skipped: Mapping[str, str], fix: str | None = None) -> UserError:
    """The error for an input of which nothing could be used; its message names the files.

    Args:
        problem: what is wrong with all of them.
        skipped: the reason for each file.
        fix: what to do.
    """
    listed = problem_list([f"{name}: {reason_alone(name, why)}" for name, why in skipped.items()])
    return UserError(f"{problem}\n{listed}", fix or "Replace these files, or name others.")


def reason_alone(name: str, problem: str) -> str:
    """A problem on one line, without the leading name of its file."""
    return one_line(problem.removeprefix(name).lstrip(":, "))


log = logging.getLogger(__name__)

#: what to do with a video among photos
ALONE = "to calibrate its camera, give it by itself; for anything else, save frames of it as photos"

#: the last two are not decoded: they are found so that messages can name them
FOUND_IN_FOLDERS = (*SUFFIXES, ".heic", ".heif")
#: names of pictures and videos that predictions write: :mod:`~sextant.chapters.calibration.written_cameras`,
#: :mod:`~sextant.chapters.places.written_matches`, :mod:`~sextant.chapters.localization.localized_drive`
WRITTEN = (
    *("*_overlay.png", "*_undistorted.png", "*_undistorted.jpg", "*calibrations.png", "matches_page*.png"),
    *("replay.mp4", "replay.gif"),
)
#: folder in the output of :mod:`~sextant.chapters.calibration.clip`, and names of the frames of a video in it
FRAMES, FRAME = "frames", f"*_frame_{'[0-9]' * 6}.jpg"


@dataclass(eq=False)
class FolderWalk:
    """The files below a folder, relative to it, in no particular order.

    Attributes:
        folder: the folder.
        files: all files, also links to nothing.
        hidden: files and folders that :func:`is_hidden`; they are not entered.
        links: links to folders; they are not entered, since they may be circular or lead to the same images twice.
        unreadable: reasons by file or folder.
    """

    folder: Path
    files: list[Path] = field(default_factory=list)
    hidden: list[Path] = field(default_factory=list)
    links: list[Path] = field(default_factory=list)
    unreadable: dict[str, str] = field(default_factory=dict)

    def left_out(self) -> Iterator[str]:
        """What was left out, hidden files apart, for messages."""
        if self.unreadable:
            yield f"left out, as it cannot be read: {', '.join(self.unreadable)}"
        if self.links:
            yield f"left out, as it is a link to a folder: {', '.join(map(str, self.links))}"


def walk_folder(folder: Path, *, deep: bool = True) -> FolderWalk:
    """List a folder, with all folders in it unless ``deep`` is false."""
    found = FolderWalk(folder)

    def failed(error: OSError) -> None:
        found.unreadable[os.path.relpath(error.filename, folder)] = f"cannot be read: {error.strerror}"

    for base, folders, files in os.walk(folder, onerror=failed):
        here = Path(base).relative_to(folder)
        found.hidden += [here / name for name in (*folders, *files) if is_hidden(name)]
        seen = [name for name in folders if not is_hidden(name)]
        links = [name for name in seen if os.path.islink(os.path.join(base, name))]
        found.links += [here / name for name in links] if deep else []
        folders[:] = [name for name in seen if name not in links] if deep else []
        for name in files:
            path = os.path.join(base, name)
            if is_hidden(name):
                continue
            if os.path.isfile(path) or not os.path.exists(path):
                found.files.append(here / name)
            else:  # reading a pipe might never end
                found.unreadable[(here / name).as_posix()] = "is not a file"
    return found


def images_below(folder: Path) -> list[Path]:
    """All image files below a folder that are not hidden; ``image2`` comes before ``image10``."""
    return sorted(image_paths(folder), key=lambda path: natural_key(path.relative_to(folder).as_posix()))


def image_paths(folder: Path, *, deep: bool = True) -> Iterator[Path]:
    """:func:`images_below` in no particular order; warns of photos in formats that are not decoded, and of links."""
    found = walk_folder(folder, deep=deep)
    for said in found.left_out():
        warn_once(f"{folder}: {said}")
    others = [path for path in found.files if path.suffix.lower() in (*FOUND_IN_FOLDERS[len(SUFFIXES) :], *RAW)]
    if others:
        why = not_decoded(folder / others[0]) or "is not decoded here"
        warn_once(f"{folder}: {counted(len(others), 'file')} left out, such as {others[0]}, which {why}")
    nameless = [path for path in found.files if is_nameless_picture(folder / path)]
    if nameless:
        warn_once(f"{folder}: {counted(len(nameless), 'file')} left out, such as {min(nameless)}{NAMELESS}: {RENAME}")
    return (folder / path for path in found.files if path.suffix.lower() in SUFFIXES and (folder / path).is_file())


def find_photos(given: str, output: Path | None, key: str = "input") -> list[Path]:
    """The photo at a path, all photos below a folder, or those matching a pattern, in order; never files written here.

    Args:
        given: path, folder or pattern. Hidden files and folders are left out unless the pattern spells their names.
        output: folder that predictions are written to, if there is one.
        key: of the argument, for messages.

    Raises:
        UserError: there is no photo.
    """
    path = Path(given).expanduser()
    if path.is_file():
        return [path]
    hidden: list[Path] = []
    if path.is_dir():
        walked = walk_folder(path)
        for said in walked.left_out():
            log.warning("%s=%s: %s", key, given, said)
        candidates, hidden = [path / file for file in walked.files], [path / file for file in walked.hidden]
    else:
        spelt = {part for part in path.parts if not glob.has_magic(part)}
        matched, links = _matching(path)  # without names with a dot
        if links:
            log.warning("%s=%s: left out, as it is a link to a folder: %s", key, given, ", ".join(map(str, links)))
        hidden = [p for p in matched if any(SYSTEM.fullmatch(part.lower()) for part in {*p.parts} - spelt)]
        candidates = [p for p in matched if p not in set(hidden)]
    written = None if output is None else output.resolve()
    candidates = [p for p in candidates if written is None or not _is_written(p, written, path)]
    found = sorted(
        p
        for p in candidates
        if p.suffix.lower() in FOUND_IN_FOLDERS
        and (os.path.isfile(p) or (os.path.islink(p) and not os.path.exists(p)))  # the reader reports broken links
    )
    others = _others(candidates)
    if not found:
        there = path.exists() or glob.has_magic(given)
        why = f"{given}: no photo there" if there else absent(path)
        if not path.exists() and "[" in given:
            why += "; brackets of a pattern stand for one of the characters in them: write [[] for [ in a name"
        why += "".join(f", but {which}: {fix}" for which, _, fix in others)
        if hidden:
            hid = counted(len(hidden), "hidden file or folder is", "hidden files and folders are")
            why += f"; {hid} left out, such as {hidden[0]}"
        raise UserError(
            f"{key}={why}",
            "Give a photo, a folder or a pattern such as 'photos/*.jpg'. "
            f"Photos end in {', '.join(FOUND_IN_FOLDERS[:-2])}",
        )
    for which, why, fix in others:
        log.warning("%s=%s: left out %s%s: %s", key, given, which, why, fix)
    return found


def _others(candidates: Sequence[Path]) -> list[tuple[str, str, str]]:
    """Files that would be photos if they were developed, cut or named: which, why they are none, and what to do."""
    files = sorted(p for p in candidates if p.suffix.lower() not in FOUND_IN_FOLDERS and p.is_file())
    kinds = (
        ("raw file", "", ", which are not developed here", DEVELOP, lambda path: path.suffix.lower() in RAW),
        ("video", "", "", ALONE, lambda path: path.suffix.lower() in VIDEOS),
        ("file", NAMELESS, "", RENAME, is_nameless_picture),
    )
    found = []
    for kind, what, why, fix, belongs in kinds:
        if of := [path for path in files if belongs(path)]:
            found.append((f"{counted(len(of), kind)}, such as {of[0].name}{what}", why, fix))
    return found


def _matching(pattern: Path) -> tuple[list[Path], list[Path]]:
    """What matches a pattern, and the links to folders that its ``**`` does not enter, as they may be circular."""
    if "**" not in pattern.parts:
        return [Path(name) for name in glob.glob(str(pattern))], []
    at = pattern.parts.index("**")
    rest = pattern.parts[at + 1 :] or ("*",)
    found, links = dict[Path, None](), dict[Path, None]()
    for base in glob.glob(str(Path(*pattern.parts[:at]))):
        for here, folders, _ in os.walk(base):
            folders[:] = [name for name in folders if not name.startswith(".")]
            links |= dict.fromkeys(Path(here, name) for name in folders if os.path.islink(os.path.join(here, name)))
            inner, further = _matching(Path(glob.escape(here), *rest))
            found |= dict.fromkeys(inner)
            links |= dict.fromkeys(further)
    return [path for path in found if not any(parent in links for parent in path.parents)], list(links)


def _is_written(photo: Path, written: Path, given: Path) -> bool:
    """Whether a prediction wrote a file into a folder; frames count as photos if their folder is given."""
    asked_for = photo.parent == (given if given.is_dir() else given.parent)
    frame = not asked_for and photo.parent.name == FRAMES and fnmatchcase(photo.name, FRAME)
    named = frame or any(fnmatchcase(photo.name, name) for name in WRITTEN)
    return named and photo.resolve().is_relative_to(written)


#: bytes of a stem, which leave room for what is added to it: a file's name has at most 255
LONGEST = 200


def file_stems(paths: Sequence[Path], reserved: Sequence[str] = (), derived: str = "") -> list[str]:
    """A name for each photo's files: its own without suffix; with suffix, folder or a number if that is taken.

    Args:
        paths: the photos.
        reserved: names of other files that are written there, without suffix.
        derived: ending of further names that are made of a stem.
    """
    taken = {name.lower() for name in reserved}
    stems = []
    for path in paths:
        own, folder = (os.fsencode(name)[:LONGEST].decode(errors="ignore") for name in (path.stem, path.parent.name))
        wished = [own, f"{own}_{path.suffix[1:]}"[:LONGEST], f"{folder}_{own}"[:LONGEST]]
        numbered = (f"{own}_{i}" for i in range(2, len(paths) + 2))
        free = (name for name in (*wished, *numbered) if not {name.lower(), f"{name}{derived}".lower()} & taken)
        stem = next(free)
        taken |= {stem.lower(), f"{stem}{derived}".lower()}  # file systems may be case-insensitive
        stems.append(stem)
    return stems
