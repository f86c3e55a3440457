"""Images of a walk, their straightened versions, and the map's image where each was found."""

from collections.abc import Sequence
from dataclasses import dataclass

from jaxtyping import UInt8
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.style import new_figure, shortened

#: letters of a title that fit above an image
LONGEST = 26
ROWS = ("as taken", "straightened", "map, where found")


@dataclass(frozen=True)
class WalkedImage:
    """One image of a walk.

    Attributes:
        title: title, such as the file and place.
        taken: the image as the camera took it.
        straight: the image as the virtual camera would have taken it.
        mapped: the nearest image of the map; None if it is not known.
    """

    title: str
    taken: UInt8[ndarray, "h w 3"]
    straight: UInt8[ndarray, "vh vw 3"]
    mapped: UInt8[ndarray, "vh vw 3"] | None


def straightened_walk(images: Sequence[WalkedImage]) -> Figure:
    """Draw one column for each image, and a row for each stage that it has gone through.

    >>> import numpy as np
    >>> taken, straight = np.zeros((30, 40, 3), np.uint8), np.zeros((24, 32, 3), np.uint8)
    >>> figure = straightened_walk([WalkedImage(place, taken, straight, None) for place in ("hall", "stairs")])
    >>> len(figure.axes), figure.axes[0].get_title(), figure.axes[2].get_ylabel()
    (4, 'hall', 'straightened')
    """
    stages = [[each.taken, each.straight, *([] if each.mapped is None else [each.mapped])] for each in images]
    rows, columns = max(map(len, stages)), len(images)
    figure, axes = new_figure(1.7 * columns + 0.3, 1.35 * rows + 0.2, rows=rows, columns=columns)
    for column, (image, pictures) in enumerate(zip(images, stages, strict=True)):
        for row in range(rows):
            cell = axes[row * columns + column]
            cell.set_xticks([])
            cell.set_yticks([])
            if row < len(pictures):
                cell.imshow(pictures[row], cmap="gray", vmin=0, vmax=255)
            if column == 0:
                cell.set_ylabel(ROWS[row], fontsize=7)
        axes[column].set_title(shortened(image.title, LONGEST), fontsize=7, pad=2)
    return figure
