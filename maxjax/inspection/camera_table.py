"""Cameras by name, with the numbers of their makers.

Sensors and focal lengths [mm], intervals between photos [s], and the range of the gimbal [deg] as far as the maker
states it for mapping; cameras that are carried by gimbals of other makers look from straight down to level.
"""

from __future__ import annotations

from typing import Any

_DJI = "DJI, specifications of {}"
_QGC = "QGroundControl 5.0, CameraMetaData.json"

CAMERAS: tuple[dict[str, Any], ...] = (
    {
        "name": "DJI M3E",
        "pixels": (5280, 3956),
        "sensor": (17.3, 13.0),
        "focal_length": 12.29,
        "gimbal": (-90.0, 35.0),
        "interval": 0.7,
        "source": _DJI.format("Mavic 3 Enterprise, wide camera"),
    },
    {
        "name": "DJI M3T",
        "pixels": (4000, 3000),
        "field_of_view": 84.0,
        "gimbal": (-90.0, 35.0),
        "interval": 2.0,
        "source": _DJI.format("Mavic 3 Thermal, wide camera, photos of 12 megapixels"),
    },
    {
        "name": "DJI M30T",
        "pixels": (4000, 3000),
        "field_of_view": 84.0,
        "gimbal": (-90.0, 45.0),
        "interval": 0.7,
        "source": _DJI.format("Matrice 30 Series, wide camera"),
    },
    {
        "name": "DJI P1 24 mm",
        "pixels": (8192, 5460),
        "sensor": (35.9, 24.0),
        "focal_length": 24.0,
        "gimbal": (-90.0, 30.0),
        "interval": 0.7,
        "source": _DJI.format("Zenmuse P1"),
    },
    {
        "name": "DJI P1 35 mm",
        "pixels": (8192, 5460),
        "sensor": (35.9, 24.0),
        "focal_length": 35.0,
        "gimbal": (-90.0, 30.0),
        "interval": 0.7,
        "source": _DJI.format("Zenmuse P1"),
    },
    {
        "name": "DJI P1 50 mm",
        "pixels": (8192, 5460),
        "sensor": (35.9, 24.0),
        "focal_length": 50.0,
        "gimbal": (-90.0, 30.0),
        "interval": 0.7,
        "source": _DJI.format("Zenmuse P1"),
    },
    {
        "name": "DJI Phantom 4 RTK",
        "pixels": (5472, 3648),
        "sensor": (13.2, 8.8),
        "focal_length": 8.8,
        "gimbal": (-90.0, 30.0),
        "interval": 2.5,
        "source": _DJI.format("Phantom 4 RTK"),
    },
    {
        "name": "DJI Mavic 2 Pro",
        "pixels": (5472, 3648),
        "sensor": (13.2, 8.8),
        "focal_length": 10.26,
        "gimbal": (-90.0, 30.0),
        "interval": 2.0,
        "source": _DJI.format("Mavic 2 Pro, Hasselblad L1D-20c"),
    },
    {
        "name": "Sony RX1R II",
        "pixels": (7952, 5304),
        "sensor": (35.9, 24.0),
        "focal_length": 35.0,
        "interval": 1.0,
        "source": _QGC,
    },
    {
        "name": "Sony A7R IV 35 mm",
        "pixels": (9504, 6336),
        "sensor": (35.7, 23.8),
        "focal_length": 35.0,
        "interval": 1.0,
        "source": _QGC,
    },
    {
        "name": "Sony A6000 16 mm",
        "pixels": (6000, 4000),
        "sensor": (23.5, 15.6),
        "focal_length": 16.0,
        "interval": 1.0,
        "source": _QGC,
    },
    {
        "name": "Sentera 65R",
        "pixels": (9344, 7000),
        "sensor": (29.9, 22.4),
        "focal_length": 27.4,
        "interval": 0.3,
        "source": _QGC,
    },
)
