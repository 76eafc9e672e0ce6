"""Small valid files of every format of maps and areas, and what becomes of one that is read."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from maxjax import Grid, load_airspace
from maxjax.core.files import FileError
from maxjax.io import read_map
from maxjax.io.geo.earth import TangentPlane
from maxjax.io.kinds.contents import facts
from tests.fuzz import container_samples, zone_samples

# Where areas are looked at.
AIR = Grid((60, 60, 20), 4.0, (-118.0, -118.0, 2.0))
GROUND = np.broadcast_to(np.arange(20) < 1, AIR.shape)
# Where zones of many formats are, in fewer voxels.
COARSE = Grid((12, 12, 4), 20.0, (-110.0, -110.0, 10.0))
COARSE_GROUND = np.broadcast_to(np.arange(4) < 1, COARSE.shape)
BOX = [[x, y, z] for x in (0.0, 9.0) for y in (0.0, 8.0) for z in (0.0, 7.0)]
QUADS = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


def lines(*rows: str) -> bytes:
    return "\n".join([*rows, ""]).encode()


def ply(order: str) -> bytes:
    kind = {"<": "binary_little_endian", "": "ascii"}[order]
    head = lines("ply", f"format {kind} 1.0", "element cell 2", "property list uchar int of", "element vertex 8")
    head += lines("property float x", "property float y", "property float z", "element face 6")
    head += lines("property list uchar int vertex_indices", "end_header")
    if not order:
        rows = ["1 5", "0", *(" ".join(map(str, p)) for p in BOX), *("4 " + " ".join(map(str, q)) for q in QUADS)]
        return head + lines(*rows)
    body = struct.pack("<BiB", 1, 5, 0) + np.array(BOX, "<f4").tobytes()
    return head + body + b"".join(struct.pack("<B4i", 4, *quad) for quad in QUADS)


def obj() -> bytes:
    return lines(*(f"v {x} {y} {z}" for x, y, z in BOX), *("f " + " ".join(str(i + 1) for i in q) for q in QUADS))


def stl() -> bytes:
    corners = np.array(BOX, "<f4")[np.array(QUADS)[:, :3]]
    return bytes(80) + struct.pack("<I", 6) + b"".join(bytes(12) + face.tobytes() + b"\0\0" for face in corners)


def glb() -> bytes:
    document = {
        "nodes": [{"mesh": 0, "scale": [1, 2, 3]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 18, "type": "SCALAR"},
        ],
        "bufferViews": [{"byteLength": 96}, {"byteOffset": 96, "byteLength": 36}],
    }
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary = np.array(BOX, "<f4").tobytes() + np.array(QUADS, "<u2")[:, :3].tobytes()
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def cityjson() -> bytes:
    tin = {"type": "TINRelief", "geometry": [{"type": "CompositeSurface", "lod": 1, "boundaries": [[[0, 2, 4]]]}]}
    solid = {"type": "Solid", "lod": 1, "boundaries": [[[quad] for quad in QUADS]]}
    house = {"type": "Building", "geometry": [solid]}
    return json.dumps(
        {
            "type": "CityJSON",
            "version": "1.1",
            "metadata": {"referenceSystem": "https://www.opengis.net/def/crs/EPSG/0/7415"},
            "transform": {"scale": [0.5, 0.5, 0.5], "translate": [85000.0, 447000.0, 1.0]},
            "CityObjects": {"house": house, "ground": tin},
            "vertices": [[int(4 * x) for x in corner] for corner in BOX],
        }
    ).encode()


def geojson() -> bytes:
    ring = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.001], [4.3, 52.0]]
    geometry = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "geometry": geometry, "properties": {"height": 12.5, "ele": 1}}
    return json.dumps({"type": "FeatureCollection", "features": [feature]}).encode()


def areas() -> bytes:
    """A prohibited area with a hole, and one to keep in of two parts."""
    outer = [[4.3, 52.0], [4.301, 52.0], [4.301, 52.001], [4.3, 52.001], [4.3, 52.0]]
    inner = [[4.3005, 52.0005], [4.3007, 52.0005], [4.3007, 52.0007], [4.3005, 52.0005]]
    layer = {"lower": 5, "lowerReference": "AGL", "upper": 120, "upperReference": "AMSL", "uom": "m"}
    school = {"type": "Polygon", "coordinates": [outer, inner], "layer": layer}
    field = {"type": "MultiPolygon", "coordinates": [[outer], [[[x + 0.002, y] for x, y in outer]]]}
    features = [
        {"type": "Feature", "properties": {"type": "PROHIBITED"}, "geometry": school},
        {"type": "Feature", "properties": {"name": "field", "inclusion": True}, "geometry": field},
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}).encode()


def osm() -> bytes:
    nodes = [f'<node id="{i}" lat="{52 + y}" lon="{4 + x}"/>' for i, (x, y) in enumerate(np.ndindex(2, 2))]
    nodes = [node.replace('"53"', '"52.001"').replace('"5"', '"4.001"') for node in nodes]
    way = "".join(f'<nd ref="{i}"/>' for i in (0, 1, 3, 2, 0))
    way += '<tag k="building" v="yes"/><tag k="height" v="8.5"/><tag k="ele" v="2"/>'
    return lines(
        '<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6">', *nodes, f'<way id="7">{way}</way>', "</osm>"
    )


def archive(**arrays: object) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)  # type: ignore[arg-type]
    return buffer.getvalue()


def las(suffix: str) -> bytes:
    """Ground, a roof and a tree, in national coordinates."""
    laspy = pytest.importorskip("laspy", reason="needs the extra las")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [85_000.0, 447_000.0, 0.0]
    points = laspy.LasData(header)
    points.x, points.y, points.z = np.array(BOX).T + np.array([[85_000.0], [447_000.0], [0.0]])
    points.classification = np.resize([2, 6, 5], len(BOX))
    points.return_number[:] = 1
    buffer = io.BytesIO()
    points.write(buffer, do_compress=suffix == "laz")
    return buffer.getvalue()


def geotiff() -> bytes:
    rasterio = pytest.importorskip("rasterio", reason="needs the extra geotiff")
    height = np.arange(12, dtype=np.float32).reshape(3, 4)
    place = rasterio.transform.from_origin(85_000, 447_006, 2, 2)
    options = {"width": 4, "height": 3, "count": 1, "dtype": "float32", "nodata": -9999, "compress": "deflate"}
    with rasterio.MemoryFile() as memory:
        with memory.open(driver="GTiff", transform=place, crs="EPSG:28992", **options) as file:
            file.write(height, 1)
        return bytes(memory.read())


def octree(title: str, body: bytes) -> bytes:
    return lines(title, "id OcTree", "size 1", "res 0.5", "data") + body


SCENE = """<scene version="3.0.0"><default name="far" value="8"/><shape type="cube"><transform name="to_world">
<scale x="9" y="5" z="$far"/><rotate z="1" angle="30"/><translate value="13 3 10"/></transform></shape>
<shape type="rectangle"><transform name="to_world"><matrix value="10 0 0 -8  0 14 0 -10  0 0 9 0  0 0 0 1"/></transform>
</shape><shape type="sphere"/></scene>"""


def packed() -> bytes:
    """A mesh and a scene's note in an archive."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("house.obj", obj())
        archive.writestr("notes.txt", "none")
    return buffer.getvalue()


def obstacles() -> bytes:
    """Two lines of the FAA's file."""
    head = "OAS#      V CO ST CITY             LATITUDE     LONGITUDE     OBSTACLE"
    place = "27-000127 O US MN MINNEAPOLIS      44 58 30.00N 093 15 36.00W TOWER              1 00256 00456 D 2 B N"
    return lines(
        head, f"{place} 2015AGL00210OE C 2017153 ", f"{place} 2015AGL00210OE A 2017153 ".replace("30.00N", "33.60N")
    )


OBSTACLES = lines(
    "OAS,VERIFIED,COUNTRY,STATE,CITY,LATDEC,LONDEC,DMSLAT,DMSLON,TYPE,QUANTITY,AGL,AMSL,LIGHTING,ACCURACY,ACTION",
    "27-1,O,US,MN,MINNEAPOLIS,44.975,-93.26,,,TOWER,1,256,456,D,2B,C",
    "27-2,O,US,MN,MINNEAPOLIS,44.976,-93.26,,,WINDMILL,1,99,320,D,4D,A",
)
PCD = lines("VERSION .7", "FIELDS x y z", "SIZE 4 4 4", "TYPE F F F", "COUNT 1 1 1", "WIDTH 8", "HEIGHT 1", "POINTS 8")
SAMPLES: dict[str, Callable[[], bytes]] = {
    "binary.ply": lambda: ply("<"),
    "ascii.ply": lambda: ply(""),
    "a.obj": obj,
    "a.stl": stl,
    "a.glb": glb,
    "a.json": cityjson,
    "a.geojson": geojson,
    "a.osm": osm,
    "areas.geojson": areas,
    "voxels.npz": lambda: archive(occupied=np.eye(3, dtype=bool)[None], spacing=2.0, origin=np.zeros(3)),
    "points.npz": lambda: archive(points=np.array(BOX), ground=np.zeros(8, bool)),
    "a.bt": lambda: octree("# Octomap OcTree binary file", struct.pack("<3H", 3, 0b11_10_01, 0b10_01)),
    "a.ot": lambda: octree("# Octomap OcTree file", struct.pack("<fBfBfB", 1, 3, 1, 0, -1, 0)),
    "ascii.pcd": lambda: PCD + lines("DATA ascii", *(" ".join(map(str, p)) for p in BOX)),
    "binary.pcd": lambda: PCD + b"DATA binary\n" + np.array(BOX, "<f4").tobytes(),
    "packed.pcd": lambda: (
        PCD + b"DATA binary_compressed\n" + struct.pack("<II", 6, 96) + bytes([1, 0, 0, 7 << 5, 85, 1])
    ),
    "a.las": lambda: las("las"),
    "a.laz": lambda: las("laz"),
    "a.tif": geotiff,
    "a.3dmap": lambda: lines("voxel 5 6 7", "1 2 3", "4 5 6"),
    "a.csv": lambda: lines("x_min,y_min,z_min,x_max,y_max,z_max", "0,0,0,1,2,3", "5,5,5,9.5,7,8"),
    "colliders.csv": lambda: lines(
        "lat0 37.79, lon0 -122.39", "posX,posY,posZ,halfSizeX,halfSizeY,halfSizeZ", "-10,20,5,2,4,5", "30,0,10,1,1,10"
    ),
    "obstacles.dat": obstacles,
    "obstacles.csv": lambda: OBSTACLES,
    "scene.xml": lambda: SCENE.encode(),
    "a.zip": packed,
}
SAMPLES |= container_samples.SAMPLES | zone_samples.SAMPLES


def coordinates(path: Path) -> np.ndarray:
    """Of what a file holds."""
    if path.name not in ("areas.geojson", *zone_samples.SAMPLES):
        return np.asarray(facts(read_map(path)).extent)
    here = TangentPlane(52.0005, 4.3005, 0.0)
    grid, ground = (AIR, GROUND) if path.name == "areas.geojson" else (COARSE, COARSE_GROUND)
    airspace = load_airspace(path, here, grid)
    assert airspace.closed(ground, grid).shape == grid.shape
    assert all(len(remark) < 1500 and "\n" not in remark for remark in airspace.remarks)
    return np.concatenate([ring for area in airspace.areas for ring in area.rings])


def outcome(path: Path) -> str:
    """ "map" or "refused"; anything else raises."""
    try:
        found = coordinates(path)
    except FileError as error:
        sentence = str(error)
        assert "\n" not in sentence
        assert path.name in sentence
        assert len(sentence) < 1000
        cause = error.__cause__
        assert type(cause).__name__ != "TypeCheckError", cause
        assert not isinstance(cause, Warning), cause  # which tests raise, and the command line prints
        return "refused"
    assert np.isfinite(found).all()
    return "map"
