"""The newest step of a drive for its viewers, drawn only on request so that localization never waits for a viewer."""

import base64
import io
import time
from threading import Condition, Lock
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from PIL import Image

from sextant.chapters.localization.written_poses import Moment

#: seconds that a request waits for something new
PATIENCE_S = 2.0
QUALITY = 85


class Watch:
    """The view of a drive that the page shows.

    Args:
        map_positions: positions of the map's images.
        unit: unit of positions.
        pictures: show images beside the map.
    """

    def __init__(self, map_positions: Float64[ndarray, "n 2"], unit: str = "m", *, pictures: bool = True):
        from sextant.chapters.localization.figures.particles import ParticleView

        self.unit = unit
        self._view, self._drawing = ParticleView(map_positions, unit=unit, seen=pictures), Lock()
        self._changed, self._ended = Condition(), False
        self._moment: Moment | None = None
        self._began, self._told = time.monotonic(), dict[str, Any]()

    def show(self, moment: Moment) -> None:
        """Make this step the newest."""
        with self._changed:
            self._moment = moment
            self._changed.notify_all()

    def end(self) -> None:
        """Announce that there are no more steps."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def after(self, step: int, patience_s: float = PATIENCE_S) -> dict[str, Any]:
        """Wait for a step later than ``step``; return its picture and numbers, or only whether the drive has ended.

        Args:
            step: the step that the page shows; -1 for none.
            patience_s: longest wait, in seconds.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._is_after(step), patience_s)
            moment, ended = self._moment, self._ended
        if moment is None or moment.step <= step:
            return {"ended": ended}
        with self._drawing:
            if self._told.get("step") != moment.step:  # drawn for the first of several viewers
                self._told = self._drawn(moment)
            return {**self._told, "ended": ended and moment.step == self._told["step"]}

    def _is_after(self, step: int) -> bool:
        return self._moment is not None and self._moment.step > step

    def _drawn(self, moment: Moment) -> dict[str, Any]:
        file, told = io.BytesIO(), moment.row.told
        Image.fromarray(self._view.draw(moment.drawn())).save(file, "JPEG", quality=QUALITY)
        x, y, heading = told.pose.tolist()
        sx, sy, sh = told.sigmas.tolist()
        return {
            "step": moment.step,
            "name": moment.row.name,
            "picture": "data:image/jpeg;base64," + base64.b64encode(file.getvalue()).decode(),
            "state": moment.row.problem or ("lost" if told.lost else "localized"),
            "position": f"{x:.2f}, {y:.2f} ± {np.hypot(sx, sy):.2f} {self.unit}",
            "heading": f"{np.degrees(heading) % 360:.0f} ± {np.degrees(sh):.0f}°",
            "mass": f"{100 * told.mass:.0f} %",
            "off_map": f"{100 * told.off_map:.0f} %",
            "speed": f"{(moment.step + 1) / (time.monotonic() - self._began):.1f} images per second",
        }
