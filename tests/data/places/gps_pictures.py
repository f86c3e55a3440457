"""Pictures with a position in EXIF."""

from PIL import Image

GPS_BLOCK, ORIGIN = 0x8825, (57.0, 9.9, 20.0)


def wgs84():
    """COLMAP's conversions."""
    import pycolmap

    return pycolmap.GPSTransform(pycolmap.GPSTransformEllipsoid.WGS84)


def add_gps(path, east, north, heading_deg=None):
    """Say that a picture was taken so many metres from the origin, looking so far counter-clockwise from the east."""
    (latitude, longitude, altitude) = wgs84().enu_to_ellipsoid([(east, north, 0.0)], *ORIGIN)[0].tolist()
    block = {1: "N", 2: _parts(latitude), 3: "E", 4: _parts(longitude), 5: b"\0", 6: altitude}
    if heading_deg is not None:
        block |= {16: "T", 17: (90 - heading_deg) % 360}
    exif = Image.Exif()
    exif[GPS_BLOCK] = block
    with Image.open(path) as image:
        image.load()
    image.save(path, exif=exif)


def _parts(degrees):
    minutes = degrees % 1 * 60
    return float(int(degrees)), float(int(minutes)), minutes % 1 * 60
