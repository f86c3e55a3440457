"""The server of the demonstration: what it answers, in whose words, and whom it refuses."""

import errno
import io
import json
import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from cli.cosfire_detection.drawn import drawn
from PIL import Image

from sextant import cli
from sextant.cli import demo
from sextant.errors import UserError
from sextant.pages.demo import answers as answering
from sextant.pages.demo import app as serving_app
from sextant.pages.demo.answers import QUESTIONS, sample_photo
from sextant.pages.demo.app import demo_app, served
from sextant.tools.demonstration.where_taken import WhereTaken

CHINA = sample_photo("china.jpg")


@pytest.fixture(scope="module")
def client():
    return demo_app().test_client()


def ask(client, question, *files, **settings):
    """Status and answer; files are (name, content)."""
    data = {"photo": [(io.BytesIO(content), name) for name, content in files], **settings}
    response = client.post(f"/ask/{question}", data=data, content_type="multipart/form-data")
    return response.status_code, response.get_json()


def png(image):
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "PNG")
    return buffer.getvalue()


NOISE = np.random.default_rng(0).integers(0, 256, (400, 600, 3), np.uint8)


def test_a_photo_is_calibrated(client):
    status, found = ask(client, "photo", ("my house.jpg", CHINA))
    assert status == 200
    assert [each["name"] for each in found["quantities"]][:3] == ["tilt", "roll", "vertical field of view"]
    assert found["verdict"] in ("good", "weak", "not trustworthy")
    assert found["levelled"].startswith("data:image/webp")


def test_two_photos_are_compared(client):
    status, found = ask(client, "places", ("a.jpg", CHINA), ("b.jpg", sample_photo("flower.jpg")))
    assert status == 200
    assert -1 <= found["similarity"] < 0.9
    assert [each["width"] for each in found["photos"]] == [640, 640]
    assert found["known"]["other_above"] > 0
    assert found["known"]["same_below"] < 0.5


def test_an_example_is_found(client, tmp_path):
    content = drawn(tmp_path / "two.png", (440, 330), glyphs=((110, 110), (310, 190))).read_bytes()
    status, found = ask(client, "example", ("two.png", content), points="0,0.251,0.335")
    assert status == 200
    assert sum(each["score"] > 0.7 for each in found["photos"][0]["found"]) == 2


@pytest.mark.slow
def test_moves_are_tolerated_only_if_asked_for(client, tmp_path):
    upright = drawn(tmp_path / "one.png", (240, 240), glyphs=((120, 120),)).read_bytes()
    turned = png(np.asarray(Image.open(tmp_path / "one.png").rotate(90)))
    files = (("upright.png", upright), ("turned.png", turned))
    best = []
    for settings in ({}, {"turned": "on"}):
        _, found = ask(client, "example", *files, points="0,0.502,0.502", **settings)
        best.append(max((each["score"] for each in found["photos"][1]["found"]), default=0))
    assert best[0] < 0.7 < best[1]


def test_a_digit_is_read(client):
    sheet = np.full((280, 280, 3), 255, np.uint8)
    sheet[60:220, 130:150] = 0
    status, found = ask(client, "digit", ("drawing.png", png(sheet)))
    assert status == 200
    assert found["clean"]["convolution"][0] == 1
    status, found = ask(client, "digit", digit="3")
    assert (status, found["clean"]["push_pull"][0]) == (200, 3)


@pytest.mark.parametrize(
    ("question", "files", "settings", "said"),
    [
        ("photo", [], {}, "0 files were sent; 1 needed"),
        ("photo", [("notes.txt", b"plain text")], {}, "notes.txt cannot be decoded (10 bytes): it is text"),
        ("photo", [("empty.jpg", b"")], {}, "empty.jpg is empty (0 bytes)"),
        ("photo", [("film.mp4", b"\0\0\0\x18ftypmp42" + bytes(900))], {}, "film.mp4 is a video, not a photo"),
        ("photo", [("cut.jpg", CHINA[:30_000])], {}, "cut.jpg cannot be decoded (30,000 bytes): image"),
        ("photo", [("iPhone.HEIC", b"\0\0\0\x18ftypheic" + bytes(99))], {}, "iPhone.HEIC is HEIC by its content"),
        ("photo", [("tiny.png", png(NOISE[:8, :9]))], {}, "tiny.png has 9x8 pixels; the shorter side must"),
        ("photo", [("strip.png", png(NOISE[:20, :400]))], {}, "strip.png has 400x20 pixels"),
        ("photo", [("../../etc/passwd", b"root")], {}, "cannot be decoded (4 bytes): it is text"),
        ("places", [("one.jpg", CHINA)], {}, "1 file was sent; 2 needed"),
        ("places", [("a.jpg", CHINA), ("b.jpg", b"x")], {}, "b.jpg cannot be decoded (1 bytes)"),
        ("places", [("a.jpg", CHINA), ("grey.png", png(NOISE // 128 + 90))], {}, "grey.png is blank"),
        ("example", [("a.jpg", CHINA)], {}, "points: 0 given"),
        ("example", [("a.jpg", CHINA)], {"points": "0,left,0.5"}, "points=0,left,0.5 is not a point"),
        ("example", [("a.jpg", CHINA)], {"points": "0,nan,0.5"}, "lies outside the photos"),
        ("digit", [], {}, "there is no digit to read"),
        ("digit", [], {"digit": "eleven"}, "there is no digit to read"),
        ("digit", [], {"digit": "11"}, "digit=11 must be one of 0 to 9"),
        ("digit", [("white.png", png(np.full((64, 64, 3), 255, np.uint8)))], {}, "the picture is blank"),
        ("weather", [("a.jpg", CHINA)], {}, "weather: no such question"),
        ("taken", [("a.jpg", CHINA)], {"map": "mars"}, "map=mars: there is no such map"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_and_names_what_the_user_calls_the_file(client, question, files, settings, said):
    status, found = ask(client, question, *files, **settings)
    assert status == 422
    assert said in found["problem"]
    assert "\n" not in found["problem"]
    for place in (str(answering.MEMORY), tempfile.gettempdir()):
        assert place not in json.dumps(found)


@pytest.mark.slow
def test_a_strip_of_twenty_to_one_is_answered_and_not_trusted(client):
    status, found = ask(client, "photo", ("strip.png", png(np.tile(NOISE[:40], (1, 2, 1))[:, :800])))
    assert (status, found["verdict"]) == (200, "not trustworthy")
    assert any("a strip of 20:1" in reason for reason in found["reasons"])


def test_without_the_extra_a_photo_is_not_located_and_all_else_is_answered(client, tmp_path, monkeypatch):
    for k in range(2):
        Image.fromarray(NOISE[k:, : 400 - k]).save(tmp_path / f"{k}.png")
    rows = [f"{k}.png,{k},0,0,1,0,0,0" for k in range(2)]
    (tmp_path / "poses.csv").write_text("\n".join(["file,x,y,z,qw,qx,qy,qz", *rows]))
    monkeypatch.setitem(answering.MAPS, "given", lambda: WhereTaken.in_folder(tmp_path))
    for module in [name for name in sys.modules if name.partition(".")[0] == "kornia"]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, "kornia", None)
    status, found = ask(client, "taken", ("a.jpg", CHINA), map="given")
    assert (status, found["problem"]) == (422, "local features need kornia, which is not installed")
    assert found["fix"] == "pip install 'sextant-vision[local]'"
    assert ask(client, "picture", ("a.jpg", CHINA))[0] == 200


def test_the_map_of_the_user_comes_first_and_its_name_is_no_script():
    given = WhereTaken("</script><script>alert(1)", None)
    with served(given=given):
        text = demo_app().test_client().get("/").get_data(as_text=True)
    assert text.count("</script>") == 1
    first, second = json.loads(re.search(r"MAPS = (\[.*?\]), SVG", text)[1])
    assert (first["name"], second["key"]) == (given.name, "office")
    assert "given" not in answering.MAPS  # of the next server


def test_a_map_that_is_none_is_refused_before_anything_is_served(tmp_path, capsys):
    with pytest.raises(SystemExit):
        cli.run("demo", ["browser=false", f"map={tmp_path}"])
    told = capsys.readouterr()
    assert "no photo there" in told.err
    assert "http" not in told.out


def test_a_file_too_large_is_named(client, monkeypatch):
    monkeypatch.setattr(serving_app, "LARGEST_FILE", 1000)
    assert ask(client, "photo", ("large.jpg", CHINA)) == (
        422, {"problem": "the file is too large: at most 64 MB", "fix": "Save a smaller version, or as JPEG."},
    )  # fmt: skip


def test_a_request_too_large_is_refused_before_it_is_read(client, monkeypatch):
    monkeypatch.setattr(serving_app.InMemory, "max_content_length", 2000)
    status, found = ask(client, "photo", ("large.jpg", CHINA))
    assert status == 413
    assert found["problem"] == "the request is too large: at most 64 MB for a photo, 500 kB for a text"


def test_a_text_too_large_is_not_called_a_file(client):
    status, found = ask(client, "digit", digit="1" * 500_001)
    assert status == 413
    assert found["problem"] == "the request is too large: at most 64 MB for a photo, 500 kB for a text"


@pytest.fixture
def memory(monkeypatch, tmp_path):
    """Folders that stand for memory and for the default folder of temporary files."""
    for name in ("memory", "default"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(answering, "MEMORY", tmp_path / "memory")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "default"))
    return tmp_path


def full(monkeypatch, *folders):
    """Folders in which half of a file finds room."""
    write = Path.write_bytes

    def half(path, content):
        if path.parent.parent not in folders:
            return write(path, content)
        write(path, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)


def test_nothing_is_left_of_a_file(client, memory):
    (memory / "default").rmdir()  # nothing else may be written to
    for content, status in ((CHINA, 200), (b"broken", 422)):
        assert ask(client, "picture", ("photo.jpg", content))[0] == status
        assert [each.name for each in memory.rglob("*")] == ["memory"]


@pytest.mark.parametrize("missing", [True, False])
def test_where_memory_is_missing_or_full_a_temporary_file_takes_its_place(client, memory, monkeypatch, missing):
    if missing:
        (memory / "memory").rmdir()
    full(monkeypatch, memory / "memory")
    assert ask(client, "picture", ("photo.jpg", CHINA))[0] == 200
    assert not list(memory.glob("*/*"))


def test_where_there_is_no_room_at_all_the_page_is_told_what_to_do(client, memory, monkeypatch):
    full(monkeypatch, memory / "memory", memory / "default")
    status, found = ask(client, "picture", ("photo.jpg", CHINA))
    assert (status, found["problem"]) == (422, "there is no room for a temporary file: No space left on device")
    assert "TMPDIR=" in found["fix"]
    assert not list(memory.glob("*/*"))


@pytest.mark.parametrize(
    "headers",
    [
        {"Host": "evil.example"},
        {"Host": "evil.example:80", "Origin": "http://evil.example:80"},
        {"Host": "127.0.0.1.evil.example"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost:9999"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ],
)
def test_pages_of_others_are_refused(client, headers):
    for response in (client.get("/", headers=headers), client.post("/ask/digit", data={"digit": "1"}, headers=headers)):
        assert response.status_code == 403
        assert "accepts requests only from its own page" in response.get_json()["problem"]


@pytest.mark.parametrize("host", ["127.0.0.1:8000", "localhost:8000", "localhost", "[::1]:8000"])
def test_its_own_page_is_answered(client, host):
    headers = {"Host": host, "Origin": f"http://{host}", "Sec-Fetch-Site": "same-origin"}
    response = client.get("/", headers=headers)
    assert response.status_code == 200
    assert b"<title>Sextant</title>" in response.data


def test_the_page_may_run_its_own_script_and_load_nothing(client):
    response = client.get("/")
    policy = response.headers["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
    assert response.headers["Cache-Control"] == "no-store"
    assert "Access-Control-Allow-Origin" not in response.headers
    text = response.get_data(as_text=True)
    assert "LARGEST_FILE" not in text
    assert "http" not in text.replace("http://www.w3.org/2000/svg", "")


def test_samples_are_two_and_no_other_file(client):
    assert client.get("/sample/flower.jpg").data == sample_photo("flower.jpg")
    for name in ("README.txt", "..%2F__init__.py", "__init__.py"):
        assert client.get(f"/sample/{name}").status_code in (404, 422)
    assert client.get("/elsewhere").get_json() == {"problem": "404 Not Found", "fix": None}


def test_a_fault_of_ours_is_told_without_its_details(monkeypatch, caplog):
    def broken(*_):
        raise ZeroDivisionError("secret")

    monkeypatch.setitem(QUESTIONS, "photo", (1, 1, broken))
    status, found = ask(demo_app().test_client(), "photo", ("a.jpg", CHINA))
    assert (status, found["problem"]) == (500, "unexpected error: ZeroDivisionError")
    assert "secret" in caplog.text


@pytest.mark.slow
def test_a_port_that_is_taken_is_named():
    with served() as address:
        port = int(address.rstrip("/").rpartition(":")[2])
        with pytest.raises(UserError, match=f"port={port} cannot be used"):
            served(port).__enter__()
    with served(port) as again:  # it is free by now
        assert again == address


@pytest.mark.parametrize(("browser", "opens"), [(True, True), (True, False), (False, False)])
def test_the_command_serves_until_it_is_interrupted(browser, opens, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr("webbrowser.open", lambda address: opened.append(address) or opens)

    class Interrupted:
        def wait(self):
            raise KeyboardInterrupt

    monkeypatch.setattr(demo, "Event", Interrupted)
    with pytest.raises(SystemExit) as ended:
        cli.run("demo", [] if browser else ["browser=false"])
    assert ended.value.code == 130
    said = capsys.readouterr().out
    assert "http://127.0.0.1:" in said
    assert "no photo is kept" in said
    assert ("no browser was found" in said) == (browser and not opens)
    assert [address in said for address in opened] == [True] * browser
