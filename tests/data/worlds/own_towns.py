"""GeoJSON of towns, written as tests need it."""

import json

import numpy as np

#: of the middle of the towns, degrees
MIDDLE = (12.6, 55.7)


def degrees(points, middle=MIDDLE):
    """Longitude and latitude of metres east and north, on a sphere; exact to a few in a thousand."""
    x, y = np.asarray(points, float).T
    per_degree = np.pi / 180 * 6_371_000
    longitude = middle[0] + x / (per_degree * np.cos(np.radians(middle[1])))
    return np.column_stack([(longitude + 180) % 360 - 180, middle[1] + y / per_degree]).tolist()


def feature(kind, coordinates, **tags):
    return {"type": "Feature", "properties": tags, "geometry": {"type": kind, "coordinates": coordinates}}


def street(points, **tags):
    return feature("LineString", degrees(points), **tags)


def building(polygon, **tags):
    rings = (polygon.exterior, *polygon.interiors)
    return feature("Polygon", [degrees(ring.coords) for ring in rings], **tags)


def write(path, *features):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return str(path)


def streets_of(graph):
    return [street(graph.nodes[edge]) for edge in graph.edges]
