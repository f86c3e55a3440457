"""Images turned upright by the orientation of their EXIF block."""

from PIL import Image

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
#: by orientation: the matrix from directions (right, down) of the upright picture to those of the one that is stored
STORED_FROM_UPRIGHT = {
    1: ((1, 0), (0, 1)), 2: ((-1, 0), (0, 1)), 3: ((-1, 0), (0, -1)), 4: ((1, 0), (0, -1)),
    5: ((0, 1), (1, 0)), 6: ((0, 1), (-1, 0)), 7: ((0, -1), (-1, 0)), 8: ((0, -1), (1, 0)),
}  # fmt: skip


def exif_orientation(image: Image.Image) -> int:
    """1 to 8 by the EXIF block, 1 being upright; 1 too where it is broken."""
    try:
        value = int(image.getexif().get(ORIENTATION, 1))
    except Exception:  # metadata that cannot be read is no reason to refuse the picture
        return 1
    return value if value in TURN else 1


def upright(image: Image.Image) -> Image.Image:
    """A picture as it is to be looked at; loads it."""
    image.load()  # which turns a TIFF by itself, and takes the orientation away
    turn = TURN.get(exif_orientation(image))
    return image if turn is None else image.transpose(turn)


def upright_size(image: Image.Image) -> tuple[int, int]:
    """Width and height of a picture that is not loaded yet, as it is to be looked at."""
    turned = image.format != "TIFF" and exif_orientation(image) >= 5  # Pillow tells a TIFF's upright size
    return (image.height, image.width) if turned else (image.width, image.height)
