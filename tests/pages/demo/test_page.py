"""The page of the demonstration in a browser without a window, with files as a user chooses and drops them."""

import pytest
from cli.cosfire_detection.drawn import drawn
from headless import CHROMIUM, chromium

from sextant.pages.demo.answers import MAPS, sample_photo
from sextant.pages.demo.app import served
from sextant.tools.demonstration import where_else

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium: apt-get install chromium"),
]
#: what a section says once it has answered
ANSWERED = """new Promise((done) => {
  const section = document.getElementById("%s"), status = section.querySelector("[role=status]");
  const look = () => {
    if (!section.hasAttribute("aria-busy") && !/^$|…$/.test(status.firstChild?.data || "")) done(status.textContent);
  };
  new MutationObserver(look).observe(section, { attributes: true, childList: true, subtree: true });
  look();
})"""
DROP = """(() => {
  const zone = document.querySelector("%s"), given = new DataTransfer();
  for (const name of %s) given.items.add(new File(["plain text"], name));
  zone.dispatchEvent(new DragEvent("drop", { dataTransfer: given, bubbles: true, cancelable: true }));
})()"""
CLICK = """((x, y) => {
  const frame = document.querySelector("#example .frame"), box = frame.getBoundingClientRect();
  const at = { clientX: box.left + x * box.width, clientY: box.top + y * box.height };
  frame.dispatchEvent(new MouseEvent("click", { ...at, bubbles: true }));
})(%s, %s)"""
#: the first answer comes when it is released
HOLD = """(() => {
  const real = window.fetch;
  window.fetch = async (...asked) => {
    window.fetch = real;
    const response = await real(...asked), content = await response.json();
    await new Promise((release) => { window.release = release; held(); });
    return { ok: true, json: async () => content };
  };
  window.waiting = new Promise((done) => { window.held = done; });
})()"""
GONE = """(() => {
  const real = window.fetch;
  window.fetch = async () => { window.fetch = real; throw new TypeError("Failed to fetch"); };
})()"""
TRY = """(() => {
  const list = document.querySelector("#taken [name=sample]");
  document.querySelector("#taken [role=status]").replaceChildren();
  list.value = "%s";
  list.dispatchEvent(new Event("change", { bubbles: true }));
})()"""
SAME_CAMERA = """(() => {
  const list = document.querySelector("#taken [name=camera]");
  list.value = "same";
  list.dispatchEvent(new Event("change", { bubbles: true }));
})()"""
LEAD = "document.querySelector('#example .lead').textContent"
STROKE = """(() => {
  const paper = document.querySelector("canvas"), box = paper.getBoundingClientRect();
  paper.setPointerCapture = () => {};
  for (const [kind, y] of [["pointerdown", 60], ["pointermove", 220], ["pointerup", 220]])
    paper.dispatchEvent(new PointerEvent(kind, { clientX: box.left + 140, clientY: box.top + y, pointerId: 1 }));
})()"""


@pytest.fixture(scope="module")
def tab(tmp_path_factory):
    with served() as address, chromium(tmp_path_factory.mktemp("profile")) as page:
        page.open(address)
        page.call("DOM.enable")
        yield page
        assert [request for request in page.requests if not request.startswith((address, "data:", "blob:"))] == []
        assert [each for each in page.complaints if "422" not in str(each)] == []  # a mistake answered as one


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    folder = tmp_path_factory.mktemp("photos")
    for name in ("china.jpg", "flower.jpg"):
        (folder / name).write_bytes(sample_photo(name))
    (folder / "empty.jpg").write_bytes(b"")
    return folder


def choose(tab, selector, path):
    """Choose a file as the dialogue of the browser does."""
    section = f"document.querySelector('{selector}').closest('section')"
    tab.run(f"{section}.querySelector('[role=status]').replaceChildren()")  # what was said before is no answer
    root = tab.call("DOM.getDocument")["root"]["nodeId"]
    node = tab.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
    tab.call("DOM.setFileInputFiles", nodeId=node, files=[str(path)])


def press(tab, *keys):
    for key in keys:
        text = {"text": "\r"} if key == "Enter" else {}
        for kind in ("keyDown", "keyUp"):
            code = {"Enter": 13, "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40}[key]
            tab.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **text)


def answered(tab, section):
    return tab.run(ANSWERED % section)


def test_a_chosen_photo_is_drawn_and_measured(tab, photos):
    choose(tab, "#photo input[type=file]", photos / "china.jpg")
    assert answered(tab, "photo").startswith("Answered in")
    assert tab.run("document.querySelectorAll('#photo tbody tr').length") == 6
    assert tab.run("document.querySelector('#photo .chip').textContent") in ("good", "weak", "not trustworthy")
    assert tab.run("document.querySelectorAll('#photo g[data-layer=gravity] path').length") > 20
    assert tab.run("[...document.querySelectorAll('#photo img')].map((each) => each.naturalWidth)") == [640, 640]
    tab.run("document.querySelector('#photo input[data-layer=gravity]').click()")
    assert tab.run("document.querySelector('#photo g[data-layer=gravity]').style.display") == "none"


def test_a_dropped_file_that_is_no_photo_is_named(tab, photos):
    tab.run(DROP % ("#photo .drop", ["notes.txt"]))
    assert answered(tab, "photo").startswith("notes.txt cannot be decoded (10 bytes)")
    assert tab.run("document.querySelector('#photo .result').hidden")
    choose(tab, "#photo input[type=file]", photos / "empty.jpg")
    assert answered(tab, "photo").startswith("empty.jpg is empty (0 bytes)")


def test_one_file_is_taken_at_a_time(tab):
    tab.run(DROP % ("#photo .drop", ["notes.txt", "more.txt"]))
    assert answered(tab, "photo").startswith("2 files were dropped")


def test_a_sample_of_a_server_that_is_gone_is_an_answer_too(tab):
    tab.run(GONE)
    tab.run("document.querySelector('#photo .drop button').click()")
    tab.run("new Promise((done) => setTimeout(done))")
    assert answered(tab, "photo").startswith("the server does not answer")


def test_two_photos_are_compared_after_the_tab_was_chosen_by_keys(tab, photos):
    tab.run("document.getElementById('tab-photo').focus()")
    press(tab, "ArrowRight")
    assert tab.run("document.activeElement.id") == "tab-places"
    assert not tab.run("document.getElementById('places').hidden")
    choose(tab, "#places .drop:nth-of-type(1) input", photos / "china.jpg")
    assert answered(tab, "places") == "Choose a second photo."
    choose(tab, "#places .drop:nth-of-type(2) input", photos / "flower.jpg")
    assert answered(tab, "places").startswith("Answered in")
    assert float(tab.run("document.querySelector('#places .similarity').textContent")) < 0.9
    assert "of pairs of different places" in tab.run("document.querySelector('#places .lead').textContent")


@pytest.fixture
def office(tab):
    """The tab, once its map is there."""
    pytest.importorskip("kornia")
    MAPS["office"]()
    tab.run("document.getElementById('tab-taken').click()")
    return tab


def test_a_rendered_photo_is_located_and_one_of_elsewhere_is_not(office):
    office.run(TRY % "night_2")
    assert answered(office, "taken").startswith("Answered in")
    assert office.run("document.querySelector('#taken .chip').textContent") == "located"
    assert office.run("document.querySelectorAll('#taken .matched image').length") == 2
    assert office.run("document.querySelectorAll('#taken .matched line').length") > 20
    assert office.run("document.querySelectorAll('#taken .above .here').length") == 1
    x, truth = office.run("['2', '4'].map((k) => Number($(`#taken tbody td:nth-child(${k})`).textContent))")
    assert x == pytest.approx(truth, abs=0.1)
    office.run(TRY % "elsewhere_0")
    assert answered(office, "taken").startswith("Answered in")
    assert office.run("document.querySelector('#taken .chip').textContent") == "not in the map"
    assert office.run("document.querySelector('#taken .sure').hidden")
    assert office.run("document.querySelectorAll('#taken .above .view').length") == 31
    assert office.run("document.querySelectorAll('#taken .above .here').length") == 0


def test_a_photo_of_ones_own_is_not_in_the_office(office, photos):
    choose(office, "#taken input[type=file]", photos / "china.jpg")
    assert answered(office, "taken").startswith("Answered in")
    assert office.run("document.querySelector('#taken .chip').textContent") == "not in the map"
    office.run(SAME_CAMERA)  # which asks again
    assert answered(office, "taken").startswith("the map has no cameras of 640x427 pixels")


def test_an_example_is_pointed_at_by_mouse_and_by_keys(tab, photos):
    tab.run("document.getElementById('tab-example').click()")
    choose(tab, "#example .drop:nth-of-type(1) input", photos / "china.jpg")
    assert answered(tab, "example").startswith("Click an object")
    tab.run(CLICK % (0.4, 0.6))
    assert answered(tab, "example").startswith("1 of at most 3 points")
    tab.run("document.querySelector('#example .frame').focus()")
    press(tab, "ArrowLeft", "ArrowUp", "Enter")
    assert answered(tab, "example").startswith("2 of at most 3 points")
    tab.run("document.querySelector('#example .find').click()")
    assert answered(tab, "example").startswith("Answered in")
    assert tab.run("document.querySelectorAll('#example tbody tr').length") >= 2
    assert tab.run("document.querySelector('#example img.over').naturalWidth") > 0


def test_matches_are_counted_without_what_was_pointed_at(tab, tmp_path, monkeypatch):
    tab.run("document.getElementById('tab-example').click()")
    choose(
        tab, "#example .drop:nth-of-type(1) input", drawn(tmp_path / "two.png", (440, 330), ((110, 110), (310, 190)))
    )
    assert answered(tab, "example").startswith("Click an object")
    tab.run("document.querySelector('#example .frame img').decode()")
    for x in (0.251, 0.258):  # side by side, and found once
        tab.run(CLICK % (x, 0.335))
    tab.run("document.querySelector('#example .find').click()")
    assert answered(tab, "example").startswith("Answered in")
    assert tab.run(LEAD).endswith("Besides your own points, 1 match.")
    monkeypatch.setattr(where_else, "MOST_FOUND", 2)
    tab.run("document.querySelector('#example .find').click()")
    assert answered(tab, "example").startswith("Answered in")
    assert tab.run(LEAD).endswith("Besides your own points, 1 or more matches.")


def test_of_two_photos_chosen_quickly_the_later_is_shown(tab, photos):
    tab.run(HOLD)
    choose(tab, "#example .drop:nth-of-type(1) input", photos / "china.jpg")
    tab.run("waiting.then(() => null)")
    choose(tab, "#example .drop:nth-of-type(1) input", photos / "flower.jpg")
    assert answered(tab, "example").startswith("Click an object")
    tab.run("new Promise((done) => { release(); setTimeout(done); })")
    assert tab.run("document.querySelector('#example .frame img').alt") == "flower.jpg"


def test_a_drawn_digit_is_read_under_every_corruption(tab):
    tab.run("document.getElementById('tab-digit').click()")
    tab.run("document.querySelector('#digit .read').click()")
    assert answered(tab, "digit").startswith("Draw a digit first")
    tab.run(STROKE)
    tab.run("document.querySelector('#digit .read').click()")
    assert answered(tab, "digit").startswith("Answered in")
    assert tab.run("document.querySelectorAll('#digit tbody td').length") == 95
    assert tab.run("document.querySelector('#truth').value") == "1"
    few = tab.run("document.querySelectorAll('#digit span.bad').length")
    tab.run(
        "(() => { const t = document.querySelector('#truth'); t.value = 8; t.dispatchEvent(new Event('change')); })()"
    )
    assert tab.run("document.querySelectorAll('#digit span.bad').length") > few + 50


def test_it_is_not_wider_than_a_phone_in_light_and_dark(tab, tmp_path):
    papers = set()
    for dark in (False, True):
        tab.look(tmp_path / "phone.png", width=390, height=800, dark=dark)
        assert tab.run("document.documentElement.scrollWidth <= innerWidth")
        papers.add(tab.run("getComputedStyle(document.body).backgroundColor"))
    assert len(papers) == 2
