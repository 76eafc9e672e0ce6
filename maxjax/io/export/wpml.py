"""DJI's waypoint files: WPML in a KMZ, for DJI Pilot 2, FlightHub 2 and the Mobile SDK.

    wpmz/template.kml      what Pilot 2 shows and edits, and makes waylines of
    wpmz/waylines.wpml     what the aircraft flies

Heights count from where the aircraft takes off (relativeToStartPoint). It rises there to the height of the first
waypoint, and to the least that DJI takes for a take-off; a take-off below the first waypoint is upright. It flies
straight to each waypoint and stops there (toPointAndStopWithDiscontinuityCurvature), so that it cuts no corner. Where
it hears nothing of its remote control it flies on, since its lines are what was judged; it returns home, on the
pilot's demand, at the height that is clear from everywhere on the way. After the last waypoint it lands there or stays.

Where a waypoint has a look, the aircraft turns there, aims its gimbal, waits, and takes a photo, in this order; photos
by distance are an action of all waypoints from one to the other.

Each archive of the same flight has the same bytes: it has no times.
"""

from __future__ import annotations

import io
import math
import zipfile

from maxjax.io.export.stops import StopFlight, StopPoint

_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that an archive takes
_LEAST_TAKE_OFF = 2.0  # [m]
_LEAST_RETURN = 20.0  # [m]
_TURN = "toPointAndStopWithDiscontinuityCurvature"
_FILE = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:wpml="http://www.dji.com/wpmz/1.0.6">
  <Document>
    <wpml:missionConfig>
      <wpml:flyToWaylineMode>safely</wpml:flyToWaylineMode>
      <wpml:finishAction>{finish}</wpml:finishAction>
      <wpml:exitOnRCLost>goContinue</wpml:exitOnRCLost>
      <wpml:executeRCLostAction>goBack</wpml:executeRCLostAction>
      <wpml:takeOffSecurityHeight>{take_off:.3f}</wpml:takeOffSecurityHeight>
      <wpml:globalTransitionalSpeed>{speed:.6g}</wpml:globalTransitionalSpeed>
      <wpml:globalRTHHeight>{back:g}</wpml:globalRTHHeight>
    </wpml:missionConfig>
    <Folder>
{folder}
{points}
    </Folder>
  </Document>
</kml>
"""
_TEMPLATE = """      <wpml:templateType>waypoint</wpml:templateType>
      <wpml:templateId>0</wpml:templateId>
      <wpml:waylineCoordinateSysParam>
        <wpml:coordinateMode>WGS84</wpml:coordinateMode>
        <wpml:heightMode>relativeToStartPoint</wpml:heightMode>
      </wpml:waylineCoordinateSysParam>
      <wpml:autoFlightSpeed>{speed:.6g}</wpml:autoFlightSpeed>
      <wpml:globalHeight>{height:.4f}</wpml:globalHeight>
      <wpml:gimbalPitchMode>manual</wpml:gimbalPitchMode>
      <wpml:globalWaypointTurnMode>{turn}</wpml:globalWaypointTurnMode>
      <wpml:globalUseStraightLine>1</wpml:globalUseStraightLine>
      <wpml:globalWaypointHeadingParam>
        <wpml:waypointHeadingMode>followWayline</wpml:waypointHeadingMode>
        <wpml:waypointHeadingPathMode>followBadArc</wpml:waypointHeadingPathMode>
      </wpml:globalWaypointHeadingParam>"""
_WAYLINE = """      <wpml:templateId>0</wpml:templateId>
      <wpml:executeHeightMode>relativeToStartPoint</wpml:executeHeightMode>
      <wpml:waylineId>0</wpml:waylineId>
      <wpml:autoFlightSpeed>{speed:.6g}</wpml:autoFlightSpeed>"""
_POINT = """      <Placemark>
        <Point>
          <coordinates>{east:.10f},{north:.10f}</coordinates>
        </Point>
        <wpml:index>{number}</wpml:index>
{heights}
        <wpml:waypointSpeed>{speed:.6g}</wpml:waypointSpeed>
        <wpml:waypointHeadingParam>
          <wpml:waypointHeadingMode>{mode}</wpml:waypointHeadingMode>{aim}
          <wpml:waypointHeadingPathMode>followBadArc</wpml:waypointHeadingPathMode>
        </wpml:waypointHeadingParam>
        <wpml:waypointTurnParam>
          <wpml:waypointTurnMode>{turn}</wpml:waypointTurnMode>
          <wpml:waypointTurnDampingDist>0</wpml:waypointTurnDampingDist>
        </wpml:waypointTurnParam>
        <wpml:useStraightLine>1</wpml:useStraightLine>{action}
      </Placemark>"""
# Of a point of interest the height is not used.
_AIM = """
          <wpml:waypointPoiPoint>{latitude:.10f},{longitude:.10f},0.000000</wpml:waypointPoiPoint>"""
_OWN = """        <wpml:ellipsoidHeight>{height:.4f}</wpml:ellipsoidHeight>
        <wpml:height>{height:.4f}</wpml:height>
        <wpml:useGlobalHeight>0</wpml:useGlobalHeight>
        <wpml:useGlobalSpeed>0</wpml:useGlobalSpeed>
        <wpml:useGlobalHeadingParam>0</wpml:useGlobalHeadingParam>
        <wpml:useGlobalTurnParam>0</wpml:useGlobalTurnParam>"""
_GROUP = """
        <wpml:actionGroup>
          <wpml:actionGroupId>{group}</wpml:actionGroupId>
          <wpml:actionGroupStartIndex>{first}</wpml:actionGroupStartIndex>
          <wpml:actionGroupEndIndex>{last}</wpml:actionGroupEndIndex>
          <wpml:actionGroupMode>sequence</wpml:actionGroupMode>
          <wpml:actionTrigger>
            <wpml:actionTriggerType>{trigger}</wpml:actionTriggerType>{param}
          </wpml:actionTrigger>
{actions}
        </wpml:actionGroup>"""
_ACTION = """          <wpml:action>
            <wpml:actionId>{number}</wpml:actionId>
            <wpml:actionActuatorFunc>{name}</wpml:actionActuatorFunc>
            <wpml:actionActuatorFuncParam>
{params}
            </wpml:actionActuatorFuncParam>
          </wpml:action>"""


def kmz_content(flight: StopFlight) -> bytes:
    """The content of a `.kmz` file."""
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w") as archive:
        for name, template in (("wpmz/template.kml", True), ("wpmz/waylines.wpml", False)):
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type, entry.create_system = zipfile.ZIP_DEFLATED, 3
            archive.writestr(entry, _text(flight, template=template))
    return found.getvalue()


def return_height_of(flight: StopFlight) -> float:
    """The height above home of a return, in whole metres as DJI takes it [m]."""
    return max(_LEAST_RETURN, float(math.ceil(flight.return_height)))


def _text(flight: StopFlight, *, template: bool) -> str:
    speed = max(point.speed for point in flight.points)
    groups, points = 0, []
    for number, point in enumerate(flight.points):
        actions = _groups(number, flight, groups)
        points.append(_point(number, point, "".join(actions), template=template))
        groups += len(actions)
    folder = _TEMPLATE if template else _WAYLINE
    return _FILE.format(
        finish="autoLand" if flight.lands else "noAction",
        take_off=max(_LEAST_TAKE_OFF, flight.points[0].height),
        speed=speed,
        back=return_height_of(flight),
        folder=folder.format(speed=speed, height=flight.points[0].height, turn=_TURN),
        points="\n".join(points),
    )


def _groups(number: int, flight: StopFlight, first: int) -> list[str]:
    """Groups of actions of a waypoint: what is done there, and photos by the distance flown from there on."""
    point, found = flight.points[number], list[str]()
    actions = _actions(point)
    if actions:
        listed = "\n".join(
            _ACTION.format(number=k, name=name, params="\n".join(_param(*pair) for pair in params.items()))
            for k, (name, params) in enumerate(actions)
        )
        group = {"group": first, "first": number, "last": number, "trigger": "reachPoint", "param": ""}
        found.append(_GROUP.format(**group, actions=listed))
    if point.look is not None and point.look.every:
        ends = (
            k for k, other in enumerate(flight.points) if k > number and other.look and other.look.every is not None
        )
        last = next(ends, len(flight.points) - 1)
        param = f"\n            <wpml:actionTriggerParam>{point.look.every:.6g}</wpml:actionTriggerParam>"
        group = {
            "group": first + len(found),
            "first": number,
            "last": last,
            "trigger": "multipleDistance",
            "param": param,
        }
        photo = _ACTION.format(number=0, name="takePhoto", params="\n".join(_param(*pair) for pair in _PHOTO.items()))
        found.append(_GROUP.format(**group, actions=photo))
    return found


_PHOTO = {"payloadPositionIndex": "0", "useGlobalPayloadLensIndex": "0"}


def _actions(point: StopPoint) -> list[tuple[str, dict[str, str]]]:
    """What is done at a waypoint, in order: turn, aim, wait, photograph."""
    look, found = point.look, list[tuple[str, dict[str, str]]]()
    if point.heading is not None:
        heading = (point.heading + 180.0) % 360.0 - 180.0
        found.append(("rotateYaw", {"aircraftHeading": f"{heading:.2f}", "aircraftPathMode": "clockwise"}))
    if look is not None and look.pitch is not None:
        angles = {"gimbalPitchRotateEnable": "1", "gimbalPitchRotateAngle": f"{math.degrees(look.pitch):.2f}"}
        others = {f"gimbal{axis}Rotate{what}": "0" for axis in ("Roll", "Yaw") for what in ("Enable", "Angle")}
        how = {"gimbalHeadingYawBase": "north", "gimbalRotateMode": "absoluteAngle"}
        time = {"gimbalRotateTimeEnable": "0", "gimbalRotateTime": "0", "payloadPositionIndex": "0"}
        found.append(("gimbalRotate", {**how, **angles, **others, **time}))
    if point.hover > 0.0:
        found.append(("hover", {"hoverTime": f"{point.hover:.6g}"}))
    if look is not None and look.photo:
        found.append(("takePhoto", _PHOTO))
    return found


def _param(name: str, value: str) -> str:
    return f"              <wpml:{name}>{value}</wpml:{name}>"


def _point(number: int, point: StopPoint, action: str, *, template: bool) -> str:
    heights = _OWN if template else "        <wpml:executeHeight>{height:.4f}</wpml:executeHeight>"
    return _POINT.format(
        east=point.longitude,
        north=point.latitude,
        number=number,
        heights=heights.format(height=point.height),
        speed=point.speed,
        turn=_TURN,
        mode="followWayline" if point.aim is None else "towardPOI",
        aim="" if point.aim is None else _AIM.format(latitude=point.aim.latitude, longitude=point.aim.longitude),
        action=action,
    )
