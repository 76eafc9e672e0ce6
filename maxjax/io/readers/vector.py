"""Vector files of geographic information systems, by pyogrio, which holds GDAL (extra `gis`), read as GeoJSON is.

GeoPackage, Shapefile, FlatGeobuf, GML, KML, and GeoParquet where GDAL has it. Each layer with shapes is read in the
reference system that it names; several layers have to name one.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from maxjax.core.files import FileError, brief, check_regular
from maxjax.io.kinds.footprints import Footprints
from maxjax.io.readers.geojson import solids_of_features
from maxjax.io.reading import PLAIN, Reading

SUFFIXES = (".gpkg", ".shp", ".fgb", ".gml", ".parquet", ".kml")
_MISSING = "reading {} needs the extra gis: pip install 'maxjax[gis]'"
MAX_FEATURES = 5_000_000
_AT_ONCE = 50_000


def load_vector(path: Path, reading: Reading = PLAIN) -> Footprints:
    """Standing objects of a vector file: shapes with heights among their properties.

    Raises:
        FileError: if the extra is missing, GDAL does not know the file, it is damaged or too large, its layers have
            several reference systems, or it holds nothing with a height; as `reference`.
    """
    check_regular(path)
    try:
        import pyogrio
        import shapely  # noqa: F401 (needed below)
    except ImportError as error:
        raise FileError(f"{path}: {_MISSING.format(path.suffix)}") from error
    features: list[dict[str, Any]] = []
    systems: dict[str | None, str] = {}
    try:
        with warnings.catch_warnings(action="ignore"):  # of GDAL, about what is refused here or does not matter
            for layer, kind in pyogrio.list_layers(path).tolist():
                if kind is None:
                    continue  # a table without shapes
                about = pyogrio.read_info(path, layer=layer)
                if len(features) + max(about["features"], 0) > MAX_FEATURES:
                    raise FileError(f"{path}: holds more than {MAX_FEATURES} shapes; crop it to what is flown over")
                systems[about["crs"]] = layer
                meta, _, shapes, fields = pyogrio.raw.read(path, layer=layer)
                features += _features([str(name) for name in meta["fields"]], fields, shapes)
    except FileError:
        raise
    except Exception as error:  # of libraries that say so in many classes
        raise FileError(f"{path}: expected an intact {path.suffix} file: {brief(error)}") from error
    if len(systems) > 1:
        raise FileError(f"{path}: expected one reference system, found those of {', '.join(systems.values())}")
    if not features:
        raise FileError(f"{path}: expected shapes, found none")
    return solids_of_features(features, next(iter(systems)), reading, path)


def _features(names: list[str], fields: Sequence[np.ndarray], shapes: np.ndarray) -> Iterator[dict[str, Any]]:
    """Features as GeoJSON has them, of columns of properties and of shapes in well-known binary."""
    import shapely

    columns = [_plain(column) for column in fields]
    for begin in range(0, len(shapes), _AT_ONCE):
        part = slice(begin, begin + _AT_ONCE)
        texts = shapely.to_geojson(shapely.from_wkb(shapes[part]))
        for text, *values in zip(texts, *(column[part] for column in columns), strict=True):
            properties = {name: value for name, value in zip(names, values, strict=True) if value is not None}
            yield {"properties": properties, "geometry": None if text is None else json.loads(text)}


def _plain(column: np.ndarray) -> list[Any]:
    """Values of a property; None where a feature has none."""
    return [None if value is None or value != value else value for value in column.tolist()]
