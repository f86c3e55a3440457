"""Pictures of a filter as it runs: the particles over the map, what is seen, and what the map shows there."""

from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy import ndarray

from sextant.figures.localization.particle_map import ParticleFrame, draw_frame, draw_legend, draw_map, map_height
from sextant.figures.style import new_figure

PIXELS_PER_INCH = 100
#: width of the images beside the map, in inches
SEEN_WIDTH = 2.4


class ParticleView:
    """Draws moments of a filter on one figure with a fixed layout.

    Args:
        map_positions: positions of the map's images.
        width: width of the map in inches of 100 pixels.
        unit: unit of positions.
        seen: leave room beside the map for what the camera sees and for the map's image nearest to the estimate.
        walls: points on walls, if they are known.

    Raises:
        ValueError: the map has no position.

    Example:
        >>> corridor = np.column_stack([np.arange(9.0), np.zeros(9)])
        >>> view = ParticleView(corridor, width=4.0)
        >>> view.draw(ParticleFrame(np.zeros((5, 3)), np.zeros(5))).shape
        (280, 400, 3)
    """

    def __init__(
        self,
        map_positions: Float[ndarray, "n 2"],
        *,
        width: float = 6.0,
        unit: str = "m",
        seen: bool = False,
        walls: Float[ndarray, "w 2"] | None = None,
    ):
        if len(map_positions) == 0:
            raise ValueError("a view needs a map with at least one position")
        height = map_height(map_positions, width)
        self._beside: list[Axes] = []
        if seen:
            self._figure = Figure(figsize=(width + SEEN_WIDTH, max(height, 4.0)), layout="constrained")
            grid = self._figure.add_gridspec(2, 2, width_ratios=(SEEN_WIDTH, width))
            self._beside = [self._figure.add_subplot(grid[row, 0]) for row in (0, 1)]
            self._axes = self._figure.add_subplot(grid[:, 1])
            for axes, title in zip(self._beside, ("the camera", "the map, nearest to the estimate"), strict=True):
                axes.set_title(title, fontsize=9)
                axes.axis("off")
        else:
            self._figure, (self._axes,) = new_figure(width, height)
        self._canvas = FigureCanvasAgg(self._figure)
        self._figure.set_dpi(PIXELS_PER_INCH)
        draw_map(self._axes, map_positions, unit, walls)
        self._below: Any = None  # background shared by all pictures, once the first has placed the axes

    def draw(self, frame: ParticleFrame) -> UInt8[ndarray, "h w 3"]:
        """Draw the picture of a moment; both sides have an even number of pixels, as video codecs require."""
        artists = draw_frame(self._axes, frame)
        for axes, image in zip(self._beside, (frame.seen, frame.there), strict=False):
            if image is not None:
                grey = image.shape[-1] == 1
                artists.append(axes.imshow(image[..., 0] if grey else image, cmap="gray" if grey else None))
                axes.apply_aspect()  # of this image, if earlier ones had another aspect or there was none
        if self._below is None:
            draw_legend(self._figure, truth=frame.truth is not None)
            self._place(artists)
        self._canvas.restore_region(self._below)
        renderer = self._canvas.get_renderer()
        for artist in (*sorted(artists, key=Artist.get_zorder), self._axes.title):
            artist.draw(renderer)
        picture = np.asarray(self._canvas.buffer_rgba())[..., :3]
        picture = np.ascontiguousarray(picture[: picture.shape[0] // 2 * 2, : picture.shape[1] // 2 * 2])
        for artist in artists:
            artist.remove()
        return picture

    def _place(self, artists: list[Artist]) -> None:
        """Lay out the figure and keep its unchanging part, as redrawing a large map takes longer than all the rest."""
        self._canvas.draw()
        self._figure.set_layout_engine("none")  # the axes stay where the first frame puts them
        changing = [*artists, self._axes.title]
        for artist in changing:
            artist.set_visible(False)
        self._canvas.draw()
        self._below = self._canvas.copy_from_bbox(self._figure.bbox)
        for artist in changing:
            artist.set_visible(True)
