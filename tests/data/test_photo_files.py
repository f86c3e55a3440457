"""One rule for the images of a folder, whoever lists them: no hidden files, no systems' own, no links to folders."""

import os

import pytest
from PIL import Image

from sextant.chapters.localization.data.frames import find_frames
from sextant.chapters.places.photo_folder import photos_below
from sextant.data.file_kinds import is_hidden
from sextant.data.image_folder import ImageFolder
from sextant.data.photo_files import find_photos, images_below
from sextant.errors import UserError
from sextant.tools.inspection.seen import found_files

HIDDEN = [
    "._0001.jpg", ".0001.jpg", ".thumbnails/0001.jpg", ".Trash-1000/files/a.png", ".git/a.jpg", ".AppleDouble/a.jpg",
    "@eaDir/0001.jpg/SYNOFILE_THUMB_M.jpg", "@eaDir/a.jpg", "@tmp/a.jpg", "@Recycle/a.jpg", "#recycle/a.jpg",
    "#snapshot/a.png", "$RECYCLE.BIN/S-1-5/a.jpg", "RECYCLER/a.jpg", "__MACOSX/a.jpg", "__MACOSX 2/._a.jpg",
    "lost+found/a.jpg", "System Volume Information/a.jpg", "Network Trash Folder/a.jpg", "SYNOFILE_THUMB_M.jpg",
    "sub/.cache/a.webp", "sub/__MACOSX/sub/a.JPG", ".ipynb_checkpoints/a-checkpoint.png", "@EADIR/a.jpg",
]  # fmt: skip
SHOWN = [
    "0001.jpg",
    "IMG_2.JPG",
    "sub/3.PNG",
    "@548901.05@4179312.31@.jpg",
    "a.b.jpeg",
    "trash/1.jpg",
    "thumbs/2.png",
    "$a.jpg",
]


def write(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (8, 8)).save(path)


def below(paths, folder):
    return sorted(path.relative_to(folder).as_posix() for path in paths)


def listed(folder):
    """What each way to list a folder finds."""
    return [
        below(find_photos(str(folder), None), folder),
        below(images_below(folder), folder),
        sorted(path.as_posix() for path in found_files(folder).images),
        sorted(photos_below(folder).names),
        sorted(find_frames(str(folder), folder.parent / "out", 1).names),
    ]


def test_a_pattern_does_not_follow_links_to_folders(tmp_path, caplog):
    """Not even those that lead back to where it began."""
    for name in ("a.jpg", "sub/b.jpg", "sub/deep/c.jpg", "sub/.hidden/d.jpg"):
        write(tmp_path / "photos" / name)
    write(tmp_path / "elsewhere" / "e.jpg")
    (tmp_path / "photos" / "sub" / "loop").symlink_to(tmp_path / "photos")
    (tmp_path / "photos" / "other").symlink_to(tmp_path / "elsewhere")
    found = find_photos(f"{tmp_path}/photos/**/*.jpg", None)
    assert below(found, tmp_path / "photos") == ["a.jpg", "sub/b.jpg", "sub/deep/c.jpg"]
    assert "left out, as it is a link to a folder" in caplog.text
    assert below(find_photos(f"{tmp_path}/photos/**/deep/**/*.jpg", None), tmp_path / "photos") == ["sub/deep/c.jpg"]
    found = find_photos(f"{tmp_path}/photos/**/*/*.jpg", None)
    assert below(found, tmp_path / "photos") == ["sub/b.jpg", "sub/deep/c.jpg"]
    with pytest.raises(UserError, match="no photo there"):
        find_photos(f"{tmp_path}/photos/**/other/*.jpg", None)
    assert below(find_photos(f"{tmp_path}/photos/other/*.jpg", None), tmp_path / "photos") == ["other/e.jpg"]
    assert below(find_photos(f"{tmp_path}/photos/sub/**", None), tmp_path / "photos") == ["sub/b.jpg", "sub/deep/c.jpg"]


@pytest.mark.parametrize("name", HIDDEN)
def test_hidden_images_are_nobodys(tmp_path, name):
    for shown in SHOWN:
        write(tmp_path / "photos" / shown)
    write(tmp_path / "photos" / name)
    assert listed(tmp_path / "photos") == [sorted(SHOWN)] * 5


@pytest.mark.parametrize("name", ["Thumbs.db", "ehthumbs.db", ".DS_Store", "desktop.ini", "Desktop.ini"])
def test_files_of_systems_are_hidden_too(name):
    assert is_hidden(name)


def test_a_folder_of_hidden_photos_says_so_and_a_pattern_may_spell_them(tmp_path):
    write(tmp_path / ".thumbnails" / "a.jpg")
    write(tmp_path / "@eaDir" / "a.jpg")
    with pytest.raises(
        UserError, match=r"no photo there; 2 hidden files and folders are left out, such as .*(thumb|eaDir)"
    ):
        find_photos(str(tmp_path), None)
    with pytest.raises(UserError, match=r"no photo there; 1 hidden"):
        find_photos(str(tmp_path / "*" / "*.jpg"), None)
    for spelt in (".thumbnails/*.jpg", "@eaDir/*.jpg", ".thumbnails", "@eaDir/a.jpg"):
        assert [path.name for path in find_photos(str(tmp_path / spelt), None)] == ["a.jpg"]


def test_a_pattern_says_what_brackets_mean(tmp_path):
    write(tmp_path / "my [photos]" / "a.jpg")
    with pytest.raises(UserError, match=r"no photo there; brackets .*: write \[\[\] for \[ in a name"):
        find_photos(str(tmp_path / "my [photos]" / "*.jpg"), None)
    assert len(find_photos(str(tmp_path / "my [[]photos]" / "*.jpg"), None)) == 1


def test_links_are_files_or_left_out_with_a_warning_and_loops_end(tmp_path, caplog):
    photos = tmp_path / "photos"
    write(photos / "sub" / "a.jpg")
    write(tmp_path / "elsewhere" / "b.jpg")
    (photos / "link.jpg").symlink_to(tmp_path / "elsewhere" / "b.jpg")
    (photos / "loop").symlink_to(photos)
    (photos / "other").symlink_to(tmp_path / "elsewhere")
    assert listed(photos) == [["link.jpg", "sub/a.jpg"]] * 5
    assert "left out, as it is a link to a folder: loop, other" in caplog.text.replace("other, loop", "loop, other")
    (whole := tmp_path / "whole").symlink_to(photos)  # the folder that is named may be a link
    assert below(find_photos(str(whole), None), whole) == ["link.jpg", "sub/a.jpg"]


def test_photos_that_no_dataset_decodes_are_not_lost_silently(tmp_path, caplog):
    write(tmp_path / "a.jpg")
    (tmp_path / "b.HEIC").write_bytes(b"x")
    assert below(images_below(tmp_path), tmp_path) == ["a.jpg"]
    assert "1 file left out, such as b.HEIC, which is .heic" in caplog.text


def test_classes_are_no_hidden_folders(tmp_path):
    for name in ("cat/1.jpg", "cat/._1.jpg", "dog/1.JPG", ".thumbnails/1.jpg", "@eaDir/1.jpg", "__MACOSX/1.jpg"):
        write(tmp_path / name)
    write(tmp_path / "cat" / "2.gif")
    write(tmp_path / "dog" / "sub" / "3.jpg")
    source = ImageFolder(str(tmp_path))
    assert source.spec().classes == ("cat", "dog")
    write(tmp_path / "dog" / "2.jpg")
    found = {path.relative_to(tmp_path).as_posix() for split in ("train", "test") for path in source.files(split)}
    assert found == {"cat/1.jpg", "cat/2.gif", "dog/1.JPG", "dog/2.jpg"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads every folder")
def test_a_folder_that_cannot_be_read_is_named(tmp_path, caplog):
    write(tmp_path / "a.jpg")
    (shut := tmp_path / "shut").mkdir(mode=0)
    assert below(images_below(tmp_path), tmp_path) == ["a.jpg"]
    shut.chmod(0o700)
    assert "left out, as it cannot be read: shut" in caplog.text
