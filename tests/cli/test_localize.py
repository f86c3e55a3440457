"""Images localized by ``sextant localize``: of files and of a camera, watched while it goes on, and ended early."""

import csv
import json
import urllib.error
import urllib.request
from threading import Thread

import cv2
import numpy as np
import pytest
from headless import CHROMIUM, chromium
from PIL import Image

from sextant import Localizer, cli
from sextant.chapters.localization import localized_drive
from sextant.chapters.localization.data.pose_formats import read_tum
from sextant.cli import localize, predict
from sextant.errors import UserError
from sextant.pages.drive import watch as watching
from sextant.pages.drive.serving import drive_app, watched
from sextant.pages.drive.watch import Watch


def run(office, given, output, *more):
    words = [f"map={office.folder}", f"input={given}", f"output={output}", "replay=none", *more]
    localize.main(list({word.partition("=")[0]: word for word in words}.values()))
    with (output / "poses.csv").open() as file:
        return list(csv.DictReader(file))


class Device:
    """A camera that shows some images and is taken away, or that Ctrl-C ends."""

    images, opened, released = (), True, 0

    def __init__(self, number):
        self.number, self.left = number, list(self.images)

    def isOpened(self):
        return self.opened

    def read(self):
        return (True, self.left.pop(0)[..., ::-1]) if self.left else (False, None)

    def release(self):
        type(self).released += 1


@pytest.fixture
def camera(office, monkeypatch):
    """One whose images come as slowly as they are localized."""
    from sextant.chapters.localization.data import camera

    class Each(camera._Newest):
        def _read(self):
            """Nothing of its own accord."""

        def next(self):
            fine, pixels = self._device.read()
            return (0.1 * (11 - len(self._device.left)), pixels) if fine else None

    class Office(Device):
        images, released = [cv2.resize(image, (96, 64)) for image in office.images[:10]], 0

    monkeypatch.setattr(cv2, "VideoCapture", Office)
    monkeypatch.setattr(camera, "_Newest", Each)
    return Office


@pytest.mark.slow
def test_it_says_what_predict_says(office, photos, tmp_path):
    found = run(office, photos, tmp_path / "a", "seed=3")
    predict.main([f"run={office.folder}", f"input={photos}", f"output={tmp_path / 'b'}", "replay=none", "seed=3"])
    with (tmp_path / "b" / "poses.csv").open() as file:
        assert found == list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (["map=nowhere", "input=."], "map=nowhere: neither .* nor zoo:office; nowhere does not exist"),
        (["input=camera:one"], "input=camera:one: a camera is given by its number, from 0"),
        (["input=camera:0", "odometry={odometry}"], r"odometry=.* does not go with input=camera:0"),
        (["input=camera:0", "image_topic=/a"], r"image_topic=/a does not go with input=camera:0"),
        (["input=camera:0", "smooth=true"], "smooth=true needs the last image, and input=camera:0 has none"),
        (["input=.", "odometry=."], r"odometry=\. is a folder"),
        (["input=.", "seed=99999999999999999999"], "must be a whole number from 0 to 2147483647"),
        (["input=.", "particles=100000000000"], "must be a whole number from 1 to 100000"),
        (["input=.", "porte=3"], "porte"),
        (["input=.", "port=99999"], "port"),
        (["input=.", "port=8001"], "port=8001 needs live=true"),
        (["input=.", "live=false", "browser=false"], "browser=false needs live=true"),
        (
            ["map=zoo:places", "input=."],
            "map=zoo:places: neither a saved map nor a run of localization, nor zoo:office\nLocal",
        ),
    ],
)
def test_mistakes(office, tmp_path, given, problem):
    (tmp_path / "odometry.csv").write_text("x,y,theta\n0,0,0\n")
    given = [word.format(odometry=tmp_path / "odometry.csv") for word in given]
    words = {word.partition("=")[0]: word for word in (f"map={office.folder}", f"output={tmp_path / 'out'}", *given)}
    with pytest.raises(UserError, match=problem):
        localize.main(list(words.values()))


def test_a_camera_is_localized_until_it_is_taken_away(office, camera, tmp_path, capsys):
    rows = run(office, "camera:0", tmp_path / "out")
    assert [row["file"] for row in rows] == [f"image {k}" for k in range(10)]
    assert np.allclose(read_tum(tmp_path / "out" / "trajectory.tum")[0], 0.1 * np.arange(10))
    assert camera.released == 1
    assert "10 images" in capsys.readouterr().out


def test_a_camera_that_cannot_be_opened_or_shows_nothing_is_told(office, camera, tmp_path):
    camera.images = []
    with pytest.raises(UserError, match="input=camera:0 delivers no image"):
        run(office, "camera:0", tmp_path / "out")
    camera.opened = False
    with pytest.raises(UserError, match="input=camera:0 cannot be opened"):
        run(office, "camera:0", tmp_path / "out")
    assert camera.released == 2


def test_a_camera_that_is_not_there_prints_nothing_of_its_own(capfd):
    from sextant.chapters.localization.data.camera import Camera

    with pytest.raises(UserError, match="input=camera:999 cannot be opened"):
        next(Camera(999).read(None))
    assert capfd.readouterr().err == ""


def test_the_newest_image_of_a_camera_is_taken(office, monkeypatch):
    """While one is looked at, others come and are left out; none is shown twice, and every= counts all that came."""
    from sextant.chapters.localization.data.camera import Camera

    class Numbers(Device):
        images = tuple(np.full((4, 4, 3), k, np.uint8) for k in range(200))

    monkeypatch.setattr(cv2, "VideoCapture", Numbers)
    camera = Camera(0, every=3)
    seen = [int(frame.image[0, 0, 0]) for frame in camera.read((4, 4, 3))]
    assert seen == sorted(set(seen))
    assert {number % 3 for number in seen} == {0}
    assert seen[-1] == 198
    assert len(camera.times_s) == len(seen)


def interrupted_after(count, monkeypatch):
    """Ctrl-C comes while an image is localized."""
    real, calls = Localizer.step, []

    def step(self, *given, **named):
        calls.append(1)
        if len(calls) > count:
            raise KeyboardInterrupt
        return real(self, *given, **named)

    monkeypatch.setattr(localized_drive.Localizer, "step", step)


@pytest.mark.parametrize("verb", ["localize", "predict"])
def test_ctrl_c_keeps_what_was_localized(office, photos, tmp_path, monkeypatch, capsys, verb):
    interrupted_after(5, monkeypatch)
    key = "map" if verb == "localize" else "run"
    with pytest.raises(SystemExit) as ended:
        cli.run(verb, [f"{key}={office.folder}", f"input={photos}", f"output={tmp_path / 'out'}", "replay=gif"])
    assert ended.value.code == 130
    with (tmp_path / "out" / "poses.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 5
    with Image.open(tmp_path / "out" / "replay.gif") as replay:
        assert replay.n_frames == 5
    assert f"interrupted after 5 of {office.frames} images" in " ".join(capsys.readouterr().out.split())


def test_ctrl_c_during_the_animation_names_the_files_that_are_written(office, photos, tmp_path, monkeypatch, capsys):
    def write(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(localized_drive.Replay, "write", write)
    with pytest.raises(SystemExit) as ended:
        cli.run("localize", [f"map={office.folder}", f"input={photos}", f"output={tmp_path / 'out'}"])
    assert ended.value.code == 130
    said = " ".join(capsys.readouterr().out.split())
    assert "interrupted after trajectory.png: only the files named here are complete" in said
    assert "trajectory.tum" in said
    assert "replay" not in said


def test_ctrl_c_is_how_a_camera_ends(office, camera, tmp_path, monkeypatch):
    interrupted_after(4, monkeypatch)
    assert len(run(office, "camera:0", tmp_path / "out")) == 4


def test_ctrl_c_before_the_first_image_leaves_nothing(office, photos, tmp_path, monkeypatch):
    interrupted_after(0, monkeypatch)
    with pytest.raises(SystemExit) as ended:
        cli.run("localize", [f"map={office.folder}", f"input={photos}", f"output={tmp_path / 'out'}"])
    assert ended.value.code == 130
    assert not (tmp_path / "out" / "poses.csv").exists()


# -- the page ----------------------------------------------------------------------------------------------------------


def moments(office, count):
    """Some steps of the drive."""
    from sextant.chapters.localization.written_poses import Moment, Row

    localizer = Localizer.load(office.folder, particles=100)
    for k in range(count):
        told = localizer.step(office.motions[k], office.images[k])
        yield Moment.of(k, Row(f"{k:04d}.png", told), localizer, office.images[k])


@pytest.mark.slow
def test_the_page_is_told_of_each_later_step_once(office):
    localizer = Localizer.load(office.folder)
    watch = Watch(localizer.model.map.poses[:, :2].numpy())
    client = drive_app(watch).test_client()
    assert client.get("/after?step=-1").status_code == 200  # nothing came while it waited
    first, second = moments(office, 2)
    watch.show(first)
    told = client.get("/after?step=-1").get_json()
    assert told["step"] == 0
    assert told["name"] == "0000.png"
    assert told["picture"].startswith("data:image/jpeg;base64,")
    assert not told["ended"]
    watch.show(second)
    assert client.get("/after?step=0").get_json()["step"] == 1
    watch.end()
    assert client.get("/after?step=0").get_json()["ended"]
    assert client.get("/after?step=1").get_json() == {"ended": True}
    assert client.get("/after?step=one").get_json()["step"] == 1
    assert client.get("/after", headers={"Host": "evil.example"}).status_code == 403


def test_whoever_waits_is_answered_when_a_step_comes(office, monkeypatch):
    monkeypatch.setattr(watching, "PATIENCE_S", 60.0)
    localizer = Localizer.load(office.folder)
    watch, answers = Watch(localizer.model.map.poses[:, :2].numpy()), []
    waiting = [Thread(target=lambda: answers.append(watch.after(-1, 60.0))) for _ in range(2)]
    for thread in waiting:
        thread.start()
    watch.show(next(moments(office, 1)))
    for thread in waiting:
        thread.join(30)
    assert [told["step"] for told in answers] == [0, 0]


def test_the_page_is_served_while_the_drive_goes_on(office):
    localizer, addresses = Localizer.load(office.folder), []
    with watched(localizer, 0, addresses.append) as show:
        show(next(moments(office, 1)))
        with urllib.request.urlopen(f"{addresses[0]}after?step=-1") as response:
            assert json.load(response)["step"] == 0
    with pytest.raises(urllib.error.URLError, match="refused"):
        urllib.request.urlopen(addresses[0])


@pytest.mark.parametrize("opens", [True, False])
def test_the_command_shows_the_drive(office, photos, tmp_path, monkeypatch, capsys, opens):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or opens)
    run(office, photos, tmp_path / "out", "live=true")
    assert opened[0].startswith("http://127.0.0.1:")
    said = capsys.readouterr().out
    assert opened[0] in said
    assert ("no browser was found" in said) != opens
    run(office, photos, tmp_path / "out", "live=true", "browser=false")
    assert len(opened) == 1


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="Debian's chromium is not installed")
def test_the_page_shows_the_steps_in_a_browser(office, tmp_path):
    localizer, addresses = Localizer.load(office.folder), []
    shown = "new Promise((done) => { const look = () => { const now = document.getElementById('name').textContent; "
    shown += "if (now === '%s') done(now); else setTimeout(look, 50); }; look(); })"
    with chromium(tmp_path / "profile") as tab:
        with watched(localizer, 0, addresses.append) as show:
            tab.open(addresses[0])
            for moment in moments(office, 3):
                show(moment)
                tab.run(shown % moment.row.name)
            assert tab.run("document.querySelector('img').decode().then(() => 1)") == 1
            assert tab.run("document.querySelector('img').naturalWidth") > 500
            assert tab.run("document.getElementById('position').textContent").endswith(" m")
        ended = "new Promise((done) => { const look = () => { const now = document.querySelector('[role=status]')"
        ended += ".textContent; if (now.startsWith('The drive has ended')) done(now); else setTimeout(look, 50); }; "
        ended += "look(); })"
        assert tab.run(ended)
        assert not [each for each in tab.complaints if "ERR_CONNECTION_REFUSED" not in str(each)]
        assert all(each.startswith((addresses[0], "data:")) for each in tab.requests)


def test_a_table_of_true_poses_is_not_replaced(office, tmp_path):
    Image.fromarray(office.images[0]).save(tmp_path / "1.png")
    truth = tmp_path / "poses.csv"
    truth.write_text("file,x,y,heading\n1.png,0,0,0\n")
    with pytest.raises(UserError, match=r"poses.csv was not written by a localizer"):
        run(office, tmp_path / "1.png", tmp_path)
    assert truth.read_text() == "file,x,y,heading\n1.png,0,0,0\n"
    for _ in range(2):  # its own table is
        assert len(run(office, tmp_path / "1.png", tmp_path / "found")) == 1


@pytest.mark.parametrize(
    ("mine", "more"),
    [
        ("trajectory.tum", ()),
        ("trajectory.tum", ("odometry={}",)),
        ("smoothed.tum", ("smooth=true",)),
        ("trajectory.png", ()),
        ("replay.mp4", ("replay=mp4",)),
        ("replay.gif", ("replay=gif",)),
        ("poses.csv", ("odometry={}",)),
    ],
)
def test_trajectories_of_the_user_are_not_replaced(office, tmp_path, mine, more):
    Image.fromarray(office.images[0]).save(tmp_path / "1.png")
    own = tmp_path / mine
    own.write_text("x,y,theta\n0,0,0\n")
    given = [each.format(own) for each in more]
    with pytest.raises(UserError, match=f"{mine} (was not written|is a file that output=)") as error:
        run(office, tmp_path / "1.png", tmp_path, *given)
    assert "odometry=" not in "".join(more) or error.value.problem.startswith(f"odometry={own}")
    assert own.read_text() == "x,y,theta\n0,0,0\n"


def test_odometry_is_not_replaced_even_where_a_localizer_wrote_before(office, tmp_path):
    Image.fromarray(office.images[0]).save(tmp_path / "1.png")
    found = tmp_path / "found"
    run(office, tmp_path / "1.png", found)
    with pytest.raises(UserError, match="is a file that output="):
        run(office, tmp_path / "1.png", found, f"odometry={found / 'trajectory.tum'}")
    run(office, tmp_path / "1.png", tmp_path / "again", f"odometry={found / 'trajectory.tum'}")


def test_a_run_is_given_as_the_map(office):
    with pytest.raises(UserError, match="run=zoo:office: give the run as the map"):
        localize.main(["run=zoo:office", f"input={office.folder}"])
