"""JSON documents of one text, or of a line for each feature: CityJSONSeq and lines or sequences of GeoJSON (RFC 8142).

    {"type": "CityJSON", "transform": …}          first, then lines of {"type": "CityJSONFeature", "vertices": …}
    {"type": "Feature", "geometry": …}            each line

Both become the document that they are parts of. A feature of CityJSON counts its vertices from 0: they are joined, and
its faces count on.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from maxjax.core.files import FileError, parse_json, read_text

_SEPARATOR = b"\x1e"  # before each text of a sequence
_DEEPEST = 8  # levels of a solid's boundaries, and room
_LONGEST = 64  # characters of a type


def read_document(path: Path) -> Any:
    """The document of a JSON file, of one text or of a line for each feature.

    Raises:
        FileError: if the file cannot be read, or a line is no JSON, no feature, or not of the kind of the first.
    """
    content = read_text(path)
    lines = [line for line in content.replace(_SEPARATOR, b"\n").split(b"\n") if line.strip()]
    if len(lines) < 2 or not _is_object(lines[0]) or not lines[1].lstrip().startswith(b"{"):
        return parse_json(content.replace(_SEPARATOR, b"") if _SEPARATOR in content else content, path)
    texts = []
    for number, line in enumerate(lines, 1):
        try:
            texts.append(parse_json(line, path))
        except FileError as error:
            raise FileError(f"{path}: line {number}: {str(error).removeprefix(f'{path}: ')}") from error
    return _joined(texts, path)


def _is_object(line: bytes) -> bool:
    """Whether a line is a whole object."""
    line = line.strip()
    return line.startswith(b"{") and line.endswith(b"}")


def _joined(texts: list[Any], path: Path) -> dict[str, Any]:
    """The document that some texts are parts of."""
    kinds = [str(text.get("type"))[:_LONGEST] if isinstance(text, dict) else type(text).__name__ for text in texts]
    expected = ["CityJSON", *["CityJSONFeature"] * (len(texts) - 1)]
    if kinds[0] == "Feature":
        expected = ["Feature"] * len(texts)
    wrong = next((k for k, (kind, other) in enumerate(zip(kinds, expected, strict=True)) if kind != other), None)
    if wrong is not None:
        raise FileError(f"{path}: line {wrong + 1}: expected type {expected[wrong]}, found {kinds[wrong]!r}")
    if kinds[0] == "Feature":
        return {"type": "FeatureCollection", "features": texts}
    try:
        return _city(texts[0], texts[1:])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: malformed CityJSONSeq: {type(error).__name__}: {error}") from error


def _city(first: dict[str, Any], features: list[dict[str, Any]]) -> dict[str, Any]:
    """A CityJSON of its first line and its features."""
    vertices, objects = list(first.get("vertices") or []), dict(first.get("CityObjects") or {})
    for feature in features:
        begin = len(vertices)
        vertices += feature["vertices"]
        for name, thing in feature["CityObjects"].items():
            if name in objects:
                raise ValueError(f"expected each object once, found {name[:_LONGEST]!r} twice")
            objects[name] = {**thing, "geometry": [_moved(one, begin) for one in thing.get("geometry") or []]}
    return {**first, "vertices": vertices, "CityObjects": objects}


def _moved(geometry: dict[str, Any], begin: int) -> dict[str, Any]:
    """A geometry whose vertices are counted from another one."""
    return {**geometry, "boundaries": _counted(geometry["boundaries"], begin, 0)}


def _counted(part: Any, begin: int, depth: int) -> Any:
    if depth > _DEEPEST:
        raise ValueError(f"expected boundaries within {_DEEPEST} levels")
    if isinstance(part, list):
        return [_counted(one, begin, depth + 1) for one in part]
    return int(part) + begin
