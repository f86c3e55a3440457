"""EXIF blocks with tags of any type and count, which no library writes."""

import struct

from PIL import Image

BYTE, ASCII, SHORT, LONG, RATIONAL, SBYTE, UNDEFINED, SSHORT, SLONG, SRATIONAL, FLOAT, DOUBLE = range(1, 13)
FORMATS = {SHORT: "H", LONG: "I", RATIONAL: "I", SSHORT: "h", SLONG: "i", SRATIONAL: "i", FLOAT: "f", DOUBLE: "d"}
EXIF_BLOCK, GPS_BLOCK = 0x8769, 0x8825


def exif_bytes(main=None, exif=None, gps=None, order="<"):
    """A block of three directories; each is ``{tag: (type, values)}``, values bytes or numbers (rationals flat)."""
    blocks = {EXIF_BLOCK: exif, GPS_BLOCK: gps}
    main = dict(main or {})
    main |= {tag: (LONG, [0]) for tag, block in blocks.items() if block is not None}
    start = 8 + _size(main, order)
    for tag, block in blocks.items():
        if block is not None:
            main[tag] = (LONG, [start])
            start += _size(block, order)
    parts, at = [], 8
    for block in (main, *(blocks[tag] for tag in sorted(blocks) if blocks[tag] is not None)):
        parts.append(_directory(block, at, order))
        at += len(parts[-1])
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(order + "I", 8)
    return b"Exif\0\0" + head + b"".join(parts)


def with_tags(path, size=(96, 64), **blocks):
    """Save a picture with :func:`exif_bytes`."""
    Image.new("RGB", size, (90, 120, 60)).save(path, exif=exif_bytes(**blocks))
    return path


def _data(kind, values, order):
    if isinstance(values, bytes):
        return values, len(values)
    data = struct.pack(order + FORMATS[kind] * len(values), *values)
    return data, len(values) // (2 if kind in (RATIONAL, SRATIONAL) else 1)


def _size(block, order):
    data = [_data(kind, values, order)[0] for kind, values in block.values()]
    return 2 + 12 * len(block) + 4 + sum(len(each) for each in data if len(each) > 4)


def _directory(block, at, order):
    entries, behind = b"", b""
    after = at + 2 + 12 * len(block) + 4
    for tag, (kind, values) in sorted(block.items()):
        data, count = _data(kind, values, order)
        held = data.ljust(4, b"\0") if len(data) <= 4 else struct.pack(order + "I", after + len(behind))
        behind += data if len(data) > 4 else b""
        entries += struct.pack(order + "HHI", tag, kind, count) + held
    return struct.pack(order + "H", len(block)) + entries + bytes(4) + behind
