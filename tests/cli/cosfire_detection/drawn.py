"""Pictures with a glyph that has no symmetry, and others beside it."""

from PIL import Image, ImageDraw

PAPER, INK = 205, 35


def glyph(draw, x, y):
    """A thick flag whose middle is at (x, y)."""
    for box in ((-26, -28, -16, 28), (-16, -28, 24, -18), (-16, 0, 8, 10)):
        draw.rectangle([x + box[0], y + box[1], x + box[2], y + box[3]], fill=INK)


def drawn(path, size=(220, 160), glyphs=((110, 80),), discs=(), ink=INK, **options):
    """A picture at ``path``."""
    image = Image.new("L", size, PAPER)
    draw = ImageDraw.Draw(image)
    for x, y in glyphs:
        glyph(draw, x, y)
    for x, y in discs:
        draw.ellipse([x - 25, y - 25, x + 25, y + 25], outline=INK, width=9)
    path.parent.mkdir(parents=True, exist_ok=True)
    image.convert("RGB").save(path, **options)
    return path
