"""The sun's direction by date, time and place."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone, tzinfo
from zoneinfo import ZoneInfo

import numpy as np
from astral import Observer
from astral.sun import zenith_and_azimuth

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera

#: The formulas (Meeus 1991, as NOAA uses them) are right to 0.02 degrees in these years.
YEARS = (1800, 2100)


@dataclass(frozen=True)
class SolarPosition:
    """direction (3,) in which sunlight travels in the world; elevation and azimuth from true north [degree]."""

    direction: np.ndarray
    elevation: float
    azimuth: float
    messages: list[str] = field(default_factory=list)


def sun_at(time: str, zone: str, latitude: float, longitude: float, heading: float, camera: Camera) -> SolarPosition:
    """Where the sun stands, refraction included, seen by a camera whose picture's centre has this compass heading.

    time: local, ISO 8601. zone: an IANA name or an offset like +02:00. Angles in degrees, heading clockwise from
    true north. Raises InputError for times and zones that do not exist, and for a sun below the horizon.
    """
    moment, messages = _moment(time, zone)
    zenith, bearing = zenith_and_azimuth(Observer(latitude, longitude), moment)
    height = 90 - float(zenith)
    if height <= 0:
        raise InputError(f"the sun stands {-height:.1f} degrees below the horizon at {time} {zone}",
                         remedy="correct time, time_zone, latitude or longitude, or leave out the sunlight")
    ahead = camera.directions(np.array([camera.width, camera.height]) / 2)
    if np.hypot(ahead[0], ahead[2]) < 1e-6:
        raise InputError("a camera that looks straight up or down has no heading",
                         remedy="give the light's 'direction'")
    # compass bearings grow clockwise as the camera's yaw does, from -z towards +x
    yaw = np.arctan2(ahead[0], -ahead[2]) + np.radians(bearing - heading)
    up = np.radians(height)
    towards = np.array([np.cos(up) * np.sin(yaw), np.sin(up), -np.cos(up) * np.cos(yaw)])
    return SolarPosition(-towards, height, float(bearing), messages)


def _moment(time: str, zone: str) -> tuple[datetime, list[str]]:
    """The moment in UTC; a note where clocks showed this time twice."""
    try:
        local = datetime.fromisoformat(time)
    except ValueError:
        raise InputError(f"time '{time}' does not exist", remedy="write it like 2024-06-21 17:30") from None
    if not YEARS[0] <= local.year <= YEARS[1]:
        raise InputError(f"the sun of the year {local.year} is not known",
                         remedy=f"give a time from {YEARS[0]} to {YEARS[1]}")
    clock = _zone(zone)
    first, second = (local.replace(tzinfo=clock, fold=fold).astimezone(timezone.utc) for fold in (0, 1))
    if first.astimezone(clock).replace(tzinfo=None) != local:
        raise InputError(f"time '{time}' does not exist in {zone}: clocks were put forward over it",
                         remedy="correct 'time', or give 'time_zone' as an offset such as +02:00")
    twice = [] if first == second else [
        f"clocks in {zone} showed {time} twice; the first is taken: give time_zone as an offset such as +02:00"]
    return first, twice


def _zone(name: str) -> tzinfo:
    offset = re.fullmatch(r"([+-])(\d{2}):?([0-5]\d)", name)
    if offset and int(offset[2]) <= 14:
        sign = -1 if offset[1] == "-" else 1
        return timezone(sign * timedelta(hours=int(offset[2]), minutes=int(offset[3])))
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise InputError(f"time zone '{name}' is not known",
                         remedy="use a name such as Europe/Berlin, or an offset such as +02:00") from None
