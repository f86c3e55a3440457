"""A town of one's own: streets and buildings of a GeoJSON file, such as an extract of OpenStreetMap."""

import hashlib
import logging
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import shapely
from jaxtyping import Float64
from numpy import ndarray

from sextant.data.geodesy import geocentric, local_axes
from sextant.data.reconstructions.json_file import read_foreign_json
from sextant.errors import UserError
from sextant.worlds.blocks import Ground
from sextant.worlds.footprints import LEAST_M2, Footprint, fit_footprints
from sextant.worlds.given_streets import given_streets
from sextant.worlds.street_graph import StreetGraph
from sextant.worlds.street_layouts import AVENUE_WIDTH_M, STREET_WIDTH_M

log = logging.getLogger("sextant.data")

FIX = (
    "GeoJSON (RFC 7946) is expected: streets as LineString, buildings as Polygon, in degrees, longitude first.\n"
    "In Overpass turbo: Export > GeoJSON. In QGIS: Export > Save Features As > GeoJSON, CRS EPSG:4326."
)
#: ways of OpenStreetMap that no car takes, or that are none yet
NOT_DRIVEN = (
    *("bridleway", "bus_guideway", "construction", "corridor", "cycleway", "elevator", "footway", "no", "path"),
    *("pedestrian", "planned", "platform", "proposed", "raceway", "razed", "rest_area", "service", "services"),
    *("steps", "track", "via_ferrata"),
)
BROAD = ("motorway", "trunk", "primary", "secondary")
LANE_M = 3.5
#: of longitude or latitude in one file: 20 km are less even at 87 degrees north
MOST_DEG = 4.0
#: what is read of an object: the smallest and the largest value that is believed
WIDTH_M, LANES, HEIGHT_M, LEVELS = (4.0, 20.0), (1, 8), (2.0, 300.0), (1, 100)


@dataclass(frozen=True, eq=False)
class TownMap:
    """What a file says of a town, in metres east and north of its middle.

    Attributes:
        streets: as they are built, see :func:`~sextant.worlds.given_streets.given_streets`.
        footprints: of the buildings that stand; None if the file has no buildings at all.
        facts: numbers of what was read, built and left out, as plain values.
    """

    streets: StreetGraph
    footprints: list[Footprint] | None
    facts: dict[str, Any]


def load_geojson(path: Path | str) -> TownMap:
    """Streets and buildings of a GeoJSON file.

    Every ``LineString`` or ``MultiLineString`` is a street, unless some have the property ``highway``: then these alone
    are, but for footways, tracks and the like. Every ``Polygon`` or ``MultiPolygon`` is the footprint of a building,
    unless some have the property ``building``. Read of them are ``width`` and ``lanes``, ``height`` and
    ``building:levels``. What was left out is counted in ``facts`` and logged.

    Raises:
        UserError: the file cannot be read, is no GeoJSON in degrees, has a coordinate that is not finite or a line or
            ring of too few points, or no town can be made of its streets.

    Example:
        >>> town = load_geojson("examples/own_town.geojson")  # doctest: +SKIP
        >>> Town(town.streets, seed=1, footprints=town.footprints)  # doctest: +SKIP
    """
    path = Path(path).expanduser()
    content = path.read_bytes() if path.is_file() else b""
    return _load(path, hashlib.sha256(content).hexdigest())


@lru_cache(maxsize=8)
def _load(path: Path, sha256: str) -> TownMap:
    shapes, left_out = list(_shapes(path)), Counter[str]()
    streets = _chosen(shapes, "LineString", "highway", NOT_DRIVEN, left_out)
    buildings = _chosen(shapes, "Polygon", "building", ("no",), left_out)
    left_out.update("points" for kind, *_ in shapes if kind == "Point")
    if not streets:
        areas = f"; it has {len(buildings):,} buildings, and a town needs their streets too" if buildings else ""
        _refuse(path, f"has no street{_listed(left_out, '; left out: ')}{areas}")
    first = float(streets[0][0][0][0, 0])  # longitudes go on beyond 180 degrees
    for rings, _ in (*streets, *buildings):
        for ring in rings:
            ring[:, 0] = (ring[:, 0] - first + 180) % 360 - 180 + first
    corners = np.concatenate([rings[0] for rings, _ in streets])
    if (spread := float(np.ptp(corners, axis=0).max())) > MOST_DEG:
        _refuse(path, f"spans {spread:.3g} degrees, which is no town")
    middle = np.radians((corners.min(axis=0) + corners.max(axis=0)) / 2)
    lines = [_metres(rings[0], middle) for rings, _ in streets]
    try:
        graph = given_streets(lines, [_width(tags, left_out) for _, tags in streets])
    except UserError as error:
        raise UserError(f"{path}: {error.problem}", "Choose a part of a town, with streets.") from None
    outlines = [shapely.Polygon(*_rings(rings, middle)) for rings, _ in buildings]
    given = [
        Footprint(
            outline,
            _number(tags, ("height",), HEIGHT_M, left_out),
            _whole(_number(tags, ("building:levels", "levels"), LEVELS, left_out)),
        )
        for outline, (_, tags) in zip(outlines, buildings, strict=True)
    ]
    fitted = fit_footprints(given, Ground(graph)) if given else []
    stand = [footprint for footprint in fitted if footprint is not None]
    small = sum(each.outline.area < LEAST_M2 for each in given)
    left_out["buildings under 12 m²"] += small
    left_out["buildings in a street, in another or far away"] += len(fitted) - len(stand) - small
    drawn = sum(float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines)
    facts = {
        "streets": len(lines),
        "street_kilometres": {"given": round(drawn / 1000, 3), "built": round(graph.length_m / 1000, 3)},
        "buildings": {"given": len(given), "built": len(stand)},
        "left_out": dict(sorted((+left_out).items())),
    }
    log.info(
        "%s: %d streets of %.2f km, of which %.2f km are built; %d of %d buildings%s",
        path, len(lines), drawn / 1000, graph.length_m / 1000, len(stand), len(given),
        _listed(left_out, "; left out: "),
    )  # fmt: skip
    return TownMap(graph, stand if given else None, facts)


def _refuse(path: Path, problem: str) -> NoReturn:
    raise UserError(f"{path} {problem}", FIX)


def _listed(left_out: Counter[str], before: str) -> str:
    return before + ", ".join(f"{what} ({count:,})" for what, count in (+left_out).most_common()) if +left_out else ""


# -- GeoJSON -----------------------------------------------------------------------------------------------------------

Rings = list[Float64[ndarray, "n 2"]]
#: ``Point``, ``LineString`` or ``Polygon``; its points, ring by ring; its properties
Shape = tuple[str, Rings, dict[str, Any]]


def _shapes(path: Path) -> Iterator[Shape]:
    """Every simple geometry of a file, those of collections and of ``Multi...`` too."""
    root = read_foreign_json(path, FIX)
    features = root.get("features") if isinstance(root, dict) and root.get("type") == "FeatureCollection" else [root]
    for number, feature in enumerate(features if isinstance(features, list) else [None], start=1):
        bare = not isinstance(feature, dict) or feature.get("type") != "Feature"
        geometry = feature if bare else feature.get("geometry")
        if geometry is None and not bare:
            continue  # a feature without a place, which GeoJSON allows
        tags = _tags({} if bare else feature.get("properties"))
        several = isinstance(geometry, dict) and geometry.get("type") == "GeometryCollection"
        parts = _list(path, f"feature {number}", geometry.get("geometries") or []) if several else [geometry]
        for each in parts:
            yield from _simple(path, f"feature {number}", each, tags)


def _simple(path: Path, where: str, geometry: Any, tags: dict[str, Any]) -> Iterator[Shape]:
    kind, coordinates = (geometry.get(key) if isinstance(geometry, dict) else None for key in ("type", "coordinates"))
    single = str(kind).removeprefix("Multi")
    if single not in ("Point", "LineString", "Polygon") or not isinstance(coordinates, list):
        shown = repr(kind)[:40] if isinstance(geometry, dict) else type(geometry).__name__
        _refuse(path, f"is no GeoJSON: {where} has no geometry of a known type and coordinates, its type is {shown}")
    for part in coordinates if single != kind else [coordinates]:
        rings = {"Point": [[part]], "LineString": [part]}.get(single, part)
        least = {"Point": 1, "LineString": 2, "Polygon": 4}[single]
        if rings:  # what has no coordinates is as if it were not there
            yield single, [_points(path, f"{where} ({kind})", ring, least) for ring in _list(path, where, rings)], tags


def _list(path: Path, where: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        _refuse(path, f"is no GeoJSON: coordinates of {where} are not pairs of numbers")
    return value


def _points(path: Path, where: str, ring: Any, least: int) -> Float64[ndarray, "n 2"]:
    """Longitudes and latitudes in degrees; heights are dropped."""
    try:
        points = np.array([(point[0], point[1]) for point in _list(path, where, ring)], np.float64).reshape(-1, 2)
    except (TypeError, ValueError, IndexError, KeyError, OverflowError):
        _refuse(path, f"is no GeoJSON: coordinates of {where} are not pairs of numbers")
    if len(points) < least:
        has = f"{len(points)} point{'' if len(points) == 1 else 's'}"
        _refuse(path, f"is no GeoJSON: {where} has {has}; at least {least} are needed")
    if not np.isfinite(points).all():
        _refuse(path, f"has a coordinate that is not finite in {where}")
    if (np.abs(points) > (180, 90)).any():
        x, y = points[(np.abs(points) > (180, 90)).any(axis=1)][0]
        _refuse(path, f"is not in degrees: {where} has the point {x:g}, {y:g}, beyond 180 and 90; is it projected?")
    return points


def _tags(properties: Any) -> dict[str, Any]:
    """Properties of a feature, and those that programs pack into ``tags`` (osmtogeojson) or ``other_tags`` (GDAL)."""
    found = dict(properties) if isinstance(properties, Mapping) else {}
    packed, nested = found.get("other_tags"), found.get("tags")
    more = dict(re.findall(r'"([^"]+)"=>"([^"]*)"', packed)) if isinstance(packed, str) else {}
    return more | (dict(nested) if isinstance(nested, Mapping) else {}) | found


# -- what it means -----------------------------------------------------------------------------------------------------


def _chosen(
    shapes: list[Shape], kind: str, tag: str, without: Sequence[str], left_out: Counter[str]
) -> list[tuple[Rings, dict[str, Any]]]:
    """The shapes of a kind: all, or those with a tag if one has it, but for some of its values."""
    of_kind = [(rings, tags) for each, rings, tags in shapes if each == kind]
    tagged = any(tags.get(tag) for _, tags in of_kind)
    kept = []
    for rings, tags in of_kind:
        value = tags.get(tag)
        if tagged and not value:
            left_out[f"{'lines' if kind == 'LineString' else 'areas'} without {tag}"] += 1
        elif value in without:
            left_out[f"{tag}={value}"] += 1
        else:
            kept.append((rings, tags))
    return kept


def _width(tags: Mapping[str, Any], left_out: Counter[str]) -> float:
    """Of the carriageway in metres: as given, by its lanes, or by the kind of street."""
    width = _number(tags, ("width",), WIDTH_M, left_out)
    lanes = _number(tags, ("lanes",), LANES, left_out)
    if width is None and lanes is not None:
        width = float(np.clip(lanes * LANE_M, *WIDTH_M))
    broad = str(tags.get("highway")).removesuffix("_link") in BROAD
    return width or (AVENUE_WIDTH_M if broad else STREET_WIDTH_M)


def _number(
    tags: Mapping[str, Any], keys: tuple[str, ...], limits: tuple[float, float], left_out: Counter[str]
) -> float | None:
    """The value of the first key that is there, in metres if it has a unit; None, and counted, if it cannot be used."""
    given = next((tags[key] for key in keys if tags.get(key) is not None), None)
    if given is None:
        return None
    found = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*m?\s*", str(given))
    low, high = limits
    if found and low <= float(found[1]) <= high:
        return float(found[1])
    left_out[f"values of {keys[0]} other than {low:g} to {high:g}"] += 1
    return None


def _whole(number: float | None) -> int | None:
    return None if number is None else max(1, round(number))


def _rings(rings: Rings, middle: Float64[ndarray, "2"]) -> tuple[ndarray, list[ndarray]]:
    outer, *holes = (_metres(ring, middle) for ring in rings)
    return outer, holes


def _metres(degrees: Float64[ndarray, "n 2"], middle: Float64[ndarray, "2"]) -> Float64[ndarray, "n 2"]:
    """East and north in the plane that touches WGS 84 at a longitude and latitude in radians."""
    longitude, latitude = np.radians(degrees).T
    from_middle = geocentric(latitude, longitude) - geocentric(middle[1:], middle[:1])
    return np.asarray(from_middle @ local_axes(middle[1:], middle[:1])[0, :2].T)
