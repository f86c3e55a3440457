"""What the figures of localization show, read from their artists, and what a replay's file holds."""

import gc
import itertools
import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from figures.written import legend_of
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from PIL import Image
from scipy.stats import chi2

from sextant.chapters.localization.figures.particles import (
    ESTIMATE,
    TRUTH,
    ParticleFrame,
    ParticleView,
    _Gif,
    draw_frame,
    draw_legend,
    draw_map,
    particle_replay,
)
from sextant.chapters.localization.figures.success_curves import SuccessCurve, success_curves
from sextant.chapters.localization.figures.trajectories import RunErrors, trajectory_errors
from sextant.errors import UserError
from sextant.evaluation.protocols import NORDLAND_LOCALIZATION, OFFICE_LOCALIZATION
from sextant.figures.style import new_figure

MAP = np.stack(np.meshgrid(np.linspace(0, 20, 30), np.linspace(0, 10, 20)), axis=-1).reshape(-1, 2)


def moment(number=0, particles=50):
    rng = np.random.default_rng(number)
    pose = np.array([2.0 + number / 2, 5.0, 0.3])
    poses = pose + rng.normal(0, 0.5, (particles, 3))
    return ParticleFrame(poses, rng.normal(size=particles), pose, pose + 0.2, f"frame {number}", pose[None, :2])


def particle_map(positions, frame, unit="m"):
    figure, (axes,) = new_figure(6.0, 4.0)
    draw_map(axes, positions, unit)
    draw_frame(axes, frame)
    draw_legend(figure, truth=frame.truth is not None)
    return figure


def test_particles_are_coloured_by_weight_and_drawn_heaviest_last():
    frame = ParticleFrame(np.array([[1.0, 2, 0], [3, 4, 0], [5, 6, 0]]), np.array([0.0, -2.0, -900.0]))
    figure = particle_map(MAP, frame)
    (axes,) = figure.axes
    dots = axes.collections[1]
    assert dots.get_offsets().tolist() == [[5, 6], [3, 4], [1, 2]]
    np.testing.assert_allclose(dots.get_array(), [1e-4, np.exp(-2), 1])
    assert legend_of(figure) == ["map", "particles (dark: heavy)", "estimate"]


@pytest.mark.parametrize("known", [True, False])
def test_only_a_drive_with_true_poses_has_truth_in_its_legend(known):
    frame = moment() if known else replace(moment(), truth=None)
    view = ParticleView(MAP, width=3.0)
    assert not view._figure.legends
    view.draw(frame)
    view.draw(replace(frame, truth=None))
    assert ("truth" in legend_of(view._figure)) is known
    assert len(view._figure.legends) == 1


def test_truth_and_estimate_point_along_their_headings():
    frame = moment()
    assert "truth" in legend_of(particle_map(MAP, frame))
    (axes,) = particle_map(MAP, frame).axes
    assert axes.get_title() == "frame 0"
    assert axes.get_xlabel() == "x (m)"
    marks = {to_hex(line.get_color()): line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"}
    np.testing.assert_allclose(marks[to_hex(TRUTH)], frame.truth[:2])
    np.testing.assert_allclose(marks[to_hex(ESTIMATE)], frame.estimate[:2])
    arrow = axes.texts[1]
    ahead = np.array(arrow.xy) - frame.estimate[:2]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(0.3)


def test_particles_have_strokes_along_their_headings_the_heaviest_alone(monkeypatch):
    monkeypatch.setattr("sextant.chapters.localization.figures.particles.MOST_HEADINGS", 2)
    frame = ParticleFrame(np.array([[1.0, 2, 0.5], [3, 4, -1], [5, 6, 2]]), np.array([0.0, -2.0, -900.0]))
    (axes,) = particle_map(MAP, frame).axes
    (strokes,) = [each for each in axes.collections if isinstance(each, LineCollection)]
    starts, ends = np.array(strokes.get_segments()).transpose(1, 0, 2)
    np.testing.assert_allclose(starts, [[3, 4], [1, 2]])
    np.testing.assert_allclose(np.arctan2(*(ends - starts).T[::-1]), [-1, 0.5])


def test_the_ellipse_holds_95_per_cent_of_the_estimate():
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    covariance = turn @ np.diag([2.0, 0.1]) @ turn.T
    (axes,) = particle_map(MAP, replace(moment(), covariance=covariance)).axes
    (ellipse,) = axes.patches
    assert ellipse.width == pytest.approx(2 * np.sqrt(chi2.ppf(0.95, 2) * 2.0), rel=1e-3)
    assert ellipse.height == pytest.approx(2 * np.sqrt(chi2.ppf(0.95, 2) * 0.1), rel=1e-3)
    assert np.radians(ellipse.angle) % np.pi == pytest.approx(0.4)
    (axes,) = particle_map(MAP, replace(moment(), covariance=covariance, estimate=None)).axes
    assert not axes.patches  # lost


def test_a_view_shows_what_is_seen_and_what_the_map_shows_there():
    seen = np.zeros((8, 12, 3), np.uint8)
    seen[..., 0] = 255
    view = ParticleView(MAP, seen=True)
    with_both = view.draw(replace(moment(), seen=seen, there=np.full((8, 12, 1), 7, np.uint8)))
    nothing = view.draw(moment())
    assert with_both.shape == nothing.shape
    assert min(nothing.shape[:2]) >= 200
    red = (with_both == (255, 0, 0)).all(axis=2)
    assert red.sum() > 5000
    assert not (nothing == (255, 0, 0)).all(axis=2).any()  # the next moment has none of it left
    assert red.nonzero()[1].max() < with_both.shape[1] / 2  # left of the map


def test_walls_are_drawn_and_inside_the_picture():
    walls = np.array([[-8.0, 5.0], [28.0, 5.0]])
    (axes,) = (view := ParticleView(MAP, walls=walls))._figure.axes
    assert view.draw(moment()).shape[1] == 600
    low, high = axes.get_xlim()
    assert low < -8 < 28 < high
    assert axes.collections[0].get_offsets().tolist() == walls.tolist()


def test_a_railway_is_a_map_too(tmp_path):
    track = np.column_stack([np.arange(100.0), np.zeros(100)])
    (axes,) = particle_map(track, moment(), unit="frames").axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (frames)", "y (frames)")
    low, high = axes.get_ylim()
    assert low < 0 < high
    with pytest.raises(ValueError, match="at least one position"):
        ParticleView(MAP[:0])
    with pytest.raises(ValueError, match="at least one position"):
        particle_replay(MAP[:0], [moment()], tmp_path / "a.gif")


def test_a_gif_has_every_frame_and_repeats(tmp_path):
    path = tmp_path / "new" / "replay.gif"
    assert particle_replay(MAP, (moment(i) for i in range(5)), path, frames_per_second=5) == 5
    with Image.open(path) as animation:
        assert animation.n_frames == 5
        assert animation.info["loop"] == 0
        frames = []
        for number in range(5):
            animation.seek(number)
            assert animation.info["duration"] == 200
            frames.append(np.asarray(animation.convert("RGB")).astype(int))
    assert all(np.abs(a - b).max() > 100 for a, b in itertools.pairwise(frames))
    assert [file.name for file in path.parent.iterdir()] == ["replay.gif"]


def test_a_gif_is_read_back_as_it_was_written(tmp_path):
    """Images of few colours lose none: every pixel of every frame."""
    rng = np.random.default_rng(0)
    images = []
    for colours in (2, 7, 100):
        table = rng.integers(0, 256, (colours, 3)).astype(np.uint8)
        images.append(table[rng.integers(0, colours, (45, 61))])
    writer = _Gif(tmp_path / "a.gif", 10.0, images[0].shape)
    for image in images:
        writer.write(image)
    writer.close()
    with Image.open(tmp_path / "a.gif") as animation:
        for number, image in enumerate(images):
            animation.seek(number)
            np.testing.assert_array_equal(np.asarray(animation.convert("RGB")), image)


def test_a_gif_and_a_video_show_the_same(tmp_path):
    for name in ("replay.gif", "replay.mp4"):
        particle_replay(MAP, [moment(0), moment(9)], tmp_path / name)
    video = cv2.VideoCapture(str(tmp_path / "replay.mp4"))
    with Image.open(tmp_path / "replay.gif") as animation:
        for number in range(2):
            animation.seek(number)
            film = video.read()[1][..., ::-1].astype(float)
            assert np.abs(np.asarray(animation.convert("RGB")) - film).mean() < 4


def test_an_image_keeps_its_shape_if_the_first_frames_have_none():
    view = ParticleView(MAP, seen=True)
    view.draw(moment(0))
    for height, width in ((20, 60), (60, 20)):
        green = np.zeros((height, width, 3), np.uint8) + np.array([0, 255, 0], np.uint8)
        shown = (view.draw(replace(moment(1), seen=green)) == [0, 255, 0]).all(axis=2)
        rows, columns = (np.ptp(np.flatnonzero(shown.any(axis=other))) + 1 for other in (1, 0))
        assert columns / rows == pytest.approx(width / height, rel=0.1)


def test_a_gif_shows_the_particles_of_its_frame_alone(tmp_path):
    """The second frame has none of the first one's dots left: it equals an animation of that frame alone."""
    kwargs = {"width": 4.0}
    particle_replay(MAP, [moment(0), moment(9)], tmp_path / "two.gif", **kwargs)
    particle_replay(MAP, [moment(9)], tmp_path / "one.gif", **kwargs)
    with Image.open(tmp_path / "two.gif") as two, Image.open(tmp_path / "one.gif") as one:
        two.seek(1)
        np.testing.assert_array_equal(np.asarray(two.convert("RGB")), np.asarray(one.convert("RGB")))


def test_a_video_has_every_frame(tmp_path):
    path = tmp_path / "replay.mp4"
    particle_replay(MAP, (moment(i) for i in range(4)), path, frames_per_second=8)
    video = cv2.VideoCapture(str(path))
    assert (video.get(cv2.CAP_PROP_FRAME_COUNT), video.get(cv2.CAP_PROP_FPS)) == (4, 8)
    assert video.read()[1].mean() > 150  # a white ground


def held_for_each_frame(folder):
    """Bytes that a replay holds longer than the frame that they belong to, a frame.

    Before each frame the garbage is collected: matplotlib's artists refer to each other in cycles, so those of past
    frames are freed when Python next looks for cycles, and that depends on all that the process did before.
    """

    def frames(number):
        for i in range(number):
            gc.collect()
            yield moment(i)

    def peak(number):
        gc.collect()
        tracemalloc.start()
        try:
            particle_replay(MAP, frames(number), folder / "replay.gif", width=3.0)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    particle_replay(MAP, frames(1), folder / "replay.gif", width=3.0)  # fonts are read once
    gc.collect()
    gc.freeze()  # what was there before needs no looking through
    try:
        return (peak(7) - peak(2)) / 5
    finally:
        gc.unfreeze()


@pytest.mark.slow
def test_memory_does_not_grow_with_the_length(tmp_path):
    assert held_for_each_frame(tmp_path) < 10_000  # bytes; the picture of one frame has 280 x 300 x 3


@pytest.mark.slow
@pytest.mark.parametrize("kept", ["pictures", "artists"])
def test_a_replay_whose_memory_grows_would_be_found(tmp_path, monkeypatch, kept):
    held = []
    if kept == "pictures":
        write = _Gif.write
        monkeypatch.setattr(_Gif, "write", lambda self, image: (held.append(image), write(self, image)))
    else:
        monkeypatch.setattr("matplotlib.artist.Artist.remove", lambda self: None)
    assert held_for_each_frame(tmp_path) > 20_000


def test_a_replay_that_fails_leaves_no_file(tmp_path):
    def broken():
        yield moment()
        raise RuntimeError("the filter failed")

    with pytest.raises(RuntimeError):
        particle_replay(MAP, broken(), tmp_path / "replay.gif")
    with pytest.raises(UserError, match="at least one frame"):
        particle_replay(MAP, [], tmp_path / "replay.gif")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UserError, match=r"written as .gif or .mp4"):
        particle_replay(MAP, [moment()], tmp_path / "replay.avi")


def test_errors_have_a_panel_each_with_convergence_and_kidnaps():
    errors = np.geomspace(20, 0.1, 50)
    runs = {"gp": RunErrors(errors, errors * 3, 30, (10,)), "laser": RunErrors(errors * 2, errors, None)}
    position, heading = trajectory_errors(runs, OFFICE_LOCALIZATION).axes
    assert (position.get_ylabel(), heading.get_ylabel()) == ("position error (m)", "heading error (°)")
    curve, dot, kidnap, other = position.lines
    np.testing.assert_allclose(curve.get_ydata(), errors)
    assert dot.get_xydata().tolist() == [[30, errors[30]]]
    assert kidnap.get_xdata() == [10, 10]
    assert other.get_color() != curve.get_color() == dot.get_color() == kidnap.get_color()
    assert position.patches[0].get_y() + position.patches[0].get_height() == 0.5
    assert legend_of(position) == ["gp", "laser"]


def test_a_railway_has_no_heading_panel():
    errors = np.array([0.0, np.nan, 3.0])
    (axes,) = trajectory_errors({"gp": RunErrors(errors)}, NORDLAND_LOCALIZATION).axes
    assert axes.get_ylabel() == "position error (frames)"
    assert axes.lines[0].get_ydata()[0] == pytest.approx(2e-3)  # none at all has no place on the axis
    with pytest.raises(ValueError, match="no heading errors"):
        trajectory_errors({"gp": RunErrors(errors)}, OFFICE_LOCALIZATION)
    with pytest.raises(ValueError, match="at least one run"):
        trajectory_errors({}, OFFICE_LOCALIZATION)


def test_success_curves_say_how_many_particles_each_method_needs():
    counts = np.array([25, 100, 1000])
    rates = np.array([0.2, 0.95, 1.0])
    good = SuccessCurve(counts, rates, rates - 0.1, np.minimum(rates + 0.1, 1))
    bad = SuccessCurve(counts, rates / 2, rates / 4, rates)
    (axes,) = success_curves({"gp": good, "laser": bad}, "success_0.5m_10deg_10f").axes
    assert legend_of(axes) == ["gp  100", "laser  > 1,000"]
    assert axes.get_xscale() == "log"
    assert [label.get_text() for label in axes.get_xticklabels()] == ["25", "100", "1,000"]
    lower, upper = axes.collections[0].get_segments()[0][:, 1]
    assert (lower, upper) == pytest.approx((10, 30))
    with pytest.raises(ValueError, match="at least one curve"):
        success_curves({})
