"""DJI's waypoint files: WPML in a KMZ, for DJI Pilot 2, FlightHub 2 and the Mobile SDK.

    wpmz/template.kml      what Pilot 2 shows and edits, and makes waylines of
    wpmz/waylines.wpml     what the aircraft flies

Heights count from where the aircraft takes off (relativeToStartPoint). It rises there to the height of the first
waypoint, and to the least that DJI takes for a take-off; a take-off below the first waypoint is upright. It flies
straight to each waypoint and stops there (toPointAndStopWithDiscontinuityCurvature), so that it cuts no corner. Where
it hears nothing of its remote control it flies on, since its lines are what was judged; it returns home, on the
pilot's demand, at the height that is clear from everywhere on the way. After the last waypoint it lands there or stays.

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
_HOVER = """
        <wpml:actionGroup>
          <wpml:actionGroupId>{group}</wpml:actionGroupId>
          <wpml:actionGroupStartIndex>{number}</wpml:actionGroupStartIndex>
          <wpml:actionGroupEndIndex>{number}</wpml:actionGroupEndIndex>
          <wpml:actionGroupMode>sequence</wpml:actionGroupMode>
          <wpml:actionTrigger>
            <wpml:actionTriggerType>reachPoint</wpml:actionTriggerType>
          </wpml:actionTrigger>
          <wpml:action>
            <wpml:actionId>0</wpml:actionId>
            <wpml:actionActuatorFunc>hover</wpml:actionActuatorFunc>
            <wpml:actionActuatorFuncParam>
              <wpml:hoverTime>{hover:.6g}</wpml:hoverTime>
            </wpml:actionActuatorFuncParam>
          </wpml:action>
        </wpml:actionGroup>"""


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
        points.append(_point(number, point, groups, template=template))
        groups += point.hover > 0.0
    folder = _TEMPLATE if template else _WAYLINE
    return _FILE.format(
        finish="autoLand" if flight.lands else "noAction",
        take_off=max(_LEAST_TAKE_OFF, flight.points[0].height),
        speed=speed,
        back=return_height_of(flight),
        folder=folder.format(speed=speed, height=flight.points[0].height, turn=_TURN),
        points="\n".join(points),
    )


def _point(number: int, point: StopPoint, group: int, *, template: bool) -> str:
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
        action=_HOVER.format(group=group, number=number, hover=point.hover) if point.hover > 0.0 else "",
    )
