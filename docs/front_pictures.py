"""The pictures of the front page, cut from stored results so that nothing in them is too small to read on a phone.

``python docs/front_pictures.py`` writes ``docs/front/*.jpg``; the captions say what they show.
"""

from pathlib import Path

from PIL import Image

DOCS = Path(__file__).parent
RESULTS = DOCS.parent / "results"
WIDTH, GAP = 900, 8
#: left, top, right, bottom of queries at night and of the first match by day, for three rows of the gallery
NIGHT_AND_DAY = [((10, y, 142, y + 88), (153, y + 3, 283, y + 86)) for y in (44, 296, 548)]


def cut(path: Path, box: tuple[int, int, int, int]) -> Image.Image:
    """A part of a stored picture."""
    return Image.open(path).convert("RGB").crop(box)


def beside(pictures: list[Image.Image], height: int) -> Image.Image:
    """Pictures of one height in a row."""
    scaled = [
        each.resize((round(each.width * height / each.height), height), Image.Resampling.LANCZOS) for each in pictures
    ]
    row = Image.new("RGB", (sum(each.width for each in scaled) + GAP * (len(scaled) - 1), height), "white")
    left = 0
    for each in scaled:
        row.paste(each, (left, 0))
        left += each.width + GAP
    return row


def stacked(rows: list[Image.Image]) -> Image.Image:
    """Rows of one width, from top to bottom."""
    scaled = [each.resize((WIDTH, round(each.height * WIDTH / each.width)), Image.Resampling.LANCZOS) for each in rows]
    page = Image.new("RGB", (WIDTH, sum(each.height for each in scaled) + GAP * (len(scaled) - 1)), "white")
    top = 0
    for each in scaled:
        page.paste(each, (0, top))
        top += each.height + GAP
    return page


def pictures() -> dict[str, Image.Image]:
    """One picture a chapter."""
    gallery, live, noise = (
        RESULTS / "places/gallery_night_clear.png",
        RESULTS / "localization/live.jpg",
        DOCS / "push_pull_noise.png",
    )
    matches = [beside([cut(gallery, night), cut(gallery, day)], 260) for night, day in NIGHT_AND_DAY[:2]]
    camera = stacked([cut(live, (26, 219, 275, 384)), cut(live, (26, 619, 275, 783))])
    return {
        "calibration": stacked([cut(DOCS / "photos/overlay.jpg", (12, 68, 900, 565))]),
        "places": stacked(matches),
        "localization": stacked([beside([camera, cut(live, (352, 177, 976, 826))], 600)]),
        "cosfire": stacked([cut(RESULTS / "cosfire/filter.png", (10, 90, 820, 630))]),
        "push_pull": stacked(
            [beside([cut(noise, box) for box in ((10, 33, 283, 302), (310, 33, 583, 302), (610, 33, 883, 302))], 300)]
        ),
        "worlds": stacked([Image.open(DOCS / "worlds/from_above.png").convert("RGB")]),
    }


if __name__ == "__main__":
    (DOCS / "front").mkdir(exist_ok=True)
    for name, picture in pictures().items():
        picture.save(DOCS / "front" / f"{name}.jpg", quality=85)
