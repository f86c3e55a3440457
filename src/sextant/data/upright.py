"""Images turned upright according to their EXIF orientation."""

from PIL import Image

from sextant.data.metadata import as_number, exif_of, tag_of

ORIENTATION = 0x0112
TURN = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}
#: by orientation: the matrix from directions (right, down) in the upright picture to those in the stored one
STORED_FROM_UPRIGHT = {
    1: ((1, 0), (0, 1)), 2: ((-1, 0), (0, 1)), 3: ((-1, 0), (0, -1)), 4: ((1, 0), (0, -1)),
    5: ((0, 1), (1, 0)), 6: ((0, 1), (-1, 0)), 7: ((0, -1), (-1, 0)), 8: ((0, -1), (1, 0)),
}  # fmt: skip


def exif_orientation(image: Image.Image) -> int:
    """The EXIF orientation, 1 to 8, with 1 being upright; also 1 if it is missing, broken or another number."""
    value = as_number(tag_of(exif_of(image), ORIENTATION))
    return int(value) if value in TURN else 1


def upright(image: Image.Image) -> Image.Image:
    """A picture turned upright; loads it."""
    image.load()  # this turns a TIFF upright by itself, and removes its orientation
    turn = TURN.get(exif_orientation(image))
    return image if turn is None else image.transpose(turn)


def upright_size(image: Image.Image) -> tuple[int, int]:
    """Upright width and height of a picture that is not loaded yet."""
    by_pillow = image.format == "TIFF" and isinstance(tag_of(exif_of(image), ORIENTATION), int)
    turned = not by_pillow and exif_orientation(image) >= 5  # Pillow gives a TIFF's upright size
    return (image.height, image.width) if turned else (image.width, image.height)
