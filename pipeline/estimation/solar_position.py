"""The sun's direction by date, time and place."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import numpy as np
from astral import Observer
from astral.sun import azimuth, elevation

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera


@dataclass(frozen=True)
class SolarPosition:
    """direction (3,) in which sunlight travels in the world; elevation and azimuth from north [degree]."""

    direction: np.ndarray
    elevation: float
    azimuth: float
    messages: list[str] = field(default_factory=list)


def sun_at(time: str, zone: str, latitude: float, longitude: float, heading: float, camera: Camera) -> SolarPosition:
    """Where the sun stands, refraction included, seen by a camera whose optical axis has this compass heading.

    time: local, ISO 8601. zone: an IANA name or an offset like +02:00. Angles in degrees, heading clockwise from
    north. Raises InputError for times and zones that do not exist, and for a sun below the horizon.
    """
    try:
        moment = datetime.fromisoformat(time)
    except ValueError:
        raise InputError(f"time '{time}' does not exist", remedy="write it like 2024-06-21 17:30") from None
    moment = moment.replace(tzinfo=_zone(zone))
    place = Observer(latitude, longitude)
    height, bearing = float(elevation(place, moment)), float(azimuth(place, moment))
    if height <= 0:
        raise InputError(f"the sun stands {-height:.1f} degrees below the horizon at {time} {zone}",
                         remedy="correct time, time_zone, latitude or longitude, or leave out the sunlight")
    forward = camera.world_from_camera[:, 2]
    if np.hypot(forward[0], forward[2]) < 1e-6:
        raise InputError("a camera that looks straight up or down has no heading",
                         remedy="give the light's 'direction'")
    # compass bearings grow clockwise as the camera's yaw does, from -z towards +x
    yaw = np.arctan2(forward[0], -forward[2]) + np.radians(bearing - heading)
    up = np.radians(height)
    towards = np.array([np.cos(up) * np.sin(yaw), np.sin(up), -np.cos(up) * np.cos(yaw)])
    return SolarPosition(-towards, height, bearing)


def _zone(name: str):
    offset = re.fullmatch(r"([+-])(\d{2}):?(\d{2})", name)
    if offset:
        sign = -1 if offset[1] == "-" else 1
        return timezone(sign * timedelta(hours=int(offset[2]), minutes=int(offset[3])))
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        raise InputError(f"time zone '{name}' is not known",
                         remedy="use a name such as Europe/Berlin, or an offset such as +02:00") from None
