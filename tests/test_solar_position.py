"""The sun by date, time and place: published values, the seasons' geometry, clocks and compasses."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.estimation.solar_position import sun_at
from pipeline.geometry.camera import Camera, from_field_of_view, rotation

CAMERA = from_field_of_view(640, 480, 60)
OBLIQUITY = 23.44
#: The formulas are right to 0.02 degrees; air pressure and temperature, which they take as standard, move a sun
#: that stands higher than 10 degrees by less than 0.03.
FORMULAS = 0.05


def bearing_and_elevation(direction):
    """Of where the light comes from [degree], clockwise from -z, where a camera of yaw 0 looks."""
    x, y, z = -direction
    return np.degrees(np.arctan2(x, -z)) % 360, np.degrees(np.arcsin(y))


def test_worked_example_of_the_solar_position_algorithm():
    """Reda and Andreas, NREL/TP-560-34302, appendix A.5: Golden, Colorado, at 1830 m, 820 mbar and 11 degrees Celsius."""
    found = sun_at("2003-10-17 12:30:30", "-07:00", 39.742476, -105.1786, 0, CAMERA)
    assert 90 - found.elevation == pytest.approx(50.11162, abs=FORMULAS)
    assert found.azimuth == pytest.approx(194.34024, abs=FORMULAS)
    assert bearing_and_elevation(found.direction) == pytest.approx((found.azimuth, found.elevation), abs=1e-9)


def highest(day, latitude, longitude=0.0):
    """The sun's highest elevation [degree] on a day."""
    times = [f"{day} {h:02d}:{m:02d}" for h in (11, 12) for m in range(0, 60, 3)]
    return max(sun_at(time, "UTC", latitude, longitude, 0, CAMERA).elevation for time in times)


@pytest.mark.parametrize("day, latitude, declination", [
    ("2024-06-20", 52.5, OBLIQUITY), ("2024-12-21", 52.5, -OBLIQUITY), ("2024-03-20", 52.5, 0),
    ("2024-09-22", 0.0, 0), ("2024-06-20", 0.0, OBLIQUITY), ("2024-12-21", -33.9, -OBLIQUITY),
    ("2024-06-20", -33.9, OBLIQUITY), ("2024-06-20", 23.44, OBLIQUITY), ("2023-12-22", -66.0, -OBLIQUITY)])
def test_noon_of_solstices_and_equinoxes(day, latitude, declination):
    # the equinox falls up to half a day from noon, in which declination changes by 0.2 degrees; refraction lifts a sun
    # 14 degrees high by 0.06; three minutes of time near the zenith are 0.4 degrees
    assert highest(day, latitude) == pytest.approx(90 - abs(latitude - declination), abs=0.4)


@pytest.mark.parametrize("latitude, azimuth", [(52.5, 180), (-33.9, 0)])
def test_noon_sun_stands_over_the_equator(latitude, azimuth):
    found = sun_at("2024-03-20 12:07:30", "UTC", latitude, 0, 0, CAMERA)  # solar noon: clocks are 7.5 minutes ahead
    assert abs((found.azimuth - azimuth + 180) % 360 - 180) < 0.3


def test_sun_rises_in_the_east_and_sets_in_the_west_on_both_hemispheres():
    for latitude in (45, -45):
        morning, evening = (sun_at(f"2024-03-20 {time}", "UTC", latitude, 0, 0, CAMERA) for time in ("06:30", "17:45"))
        assert 60 < morning.azimuth < 120 and 240 < evening.azimuth < 300


@pytest.mark.parametrize("zone, time", [
    ("+02:00", "2024-06-21 17:30"), ("+0200", "2024-06-21 17:30"), ("Europe/Berlin", "2024-06-21 17:30"),
    ("UTC", "2024-06-21 15:30"), ("-09:30", "2024-06-21 06:00"), ("+14:00", "2024-06-22 05:30"),
    ("Asia/Kolkata", "2024-06-21 21:00"), ("Europe/Berlin", "2024-06-21T17:30:00")])
def test_one_moment_by_many_clocks(zone, time):
    assert sun_at(time, zone, 52.5, 13.4, 0, CAMERA).direction == pytest.approx(
        sun_at("2024-06-21 15:30", "UTC", 52.5, 13.4, 0, CAMERA).direction, abs=1e-12)


def test_both_sides_of_the_date_line_have_noon_at_midnight_utc():
    here = sun_at("2024-06-21 12:15", "UTC", 20, 0, 0, CAMERA)
    for longitude in (180, -180):
        there = sun_at("2024-06-21 00:15", "UTC", 20, longitude, 0, CAMERA)
        # half a day moves the clock's noon by 6 s, 0.03 degrees of the sun's path, which near the zenith is all azimuth
        assert there.direction == pytest.approx(here.direction, abs=1e-3)


@pytest.mark.parametrize("yaw, pitch, roll", [(0, 0, 0), (35, 0, 0), (-120, 20, 5), (180, -60, -30)])
@pytest.mark.parametrize("heading", [0, 90, -45, 350])
def test_heading_is_where_the_camera_looks(yaw, pitch, roll, heading):
    camera = Camera(640, 480, 500.0, np.array([320.0, 240.0]), rotation(yaw, pitch, roll), np.array([0, 1.6, 0]))
    found = sun_at("2024-06-21 15:30", "UTC", 52.5, 13.4, heading, camera)
    bearing, elevation = bearing_and_elevation(found.direction)
    # to the right of the camera by as much as the sun's bearing exceeds the heading
    assert (bearing - yaw - (found.azimuth - heading) + 180) % 360 - 180 == pytest.approx(0, abs=1e-9)
    assert elevation == pytest.approx(found.elevation, abs=1e-9)


def test_camera_that_looks_into_the_sun_has_it_in_the_middle():
    found = sun_at("2024-06-21 18:30", "UTC", 52.5, 13.4, 0, CAMERA)
    camera = from_field_of_view(640, 480, 60, pitch=found.elevation)
    towards = -sun_at("2024-06-21 18:30", "UTC", 52.5, 13.4, found.azimuth, camera).direction
    assert camera.project(camera.position + towards)[0] == pytest.approx([320, 240], abs=1e-6)


def test_heading_of_a_cropped_photograph_is_that_of_its_centre():
    camera = from_field_of_view(640, 480, 60, principal_point=np.array([100.0, 240.0]))
    found = sun_at("2024-06-21 15:30", "UTC", 52.5, 13.4, 0, CAMERA)
    level = camera.directions(np.array([320.0, 240.0]))
    bearing, _ = bearing_and_elevation(sun_at("2024-06-21 15:30", "UTC", 52.5, 13.4, 10, camera).direction)
    assert bearing == pytest.approx(found.azimuth - 10 + np.degrees(np.arctan2(level[0], -level[2])), abs=1e-9)


def test_leap_days():
    leap, first = (sun_at(f"{day} 12:00", "UTC", 50, 0, 0, CAMERA) for day in ("2024-02-29", "2024-03-01"))
    assert 0.3 < first.elevation - leap.elevation < 0.45, "a day's declination in early March"
    assert sun_at("2000-02-29 12:00", "UTC", 50, 0, 0, CAMERA).elevation > 0


def test_time_that_clocks_showed_twice_is_said():
    # clocks go back at night: only a polar summer shows the sun then
    found = sun_at("2024-10-27 02:30", "Europe/Berlin", -80, 13, 0, CAMERA)
    assert "Europe/Berlin showed 2024-10-27 02:30 twice; the first is taken" in found.messages[0]
    assert found.direction == pytest.approx(sun_at("2024-10-27 00:30", "UTC", -80, 13, 0, CAMERA).direction)
    assert sun_at("2024-10-27 12:30", "Europe/Berlin", 52, 13, 0, CAMERA).messages == []


@pytest.mark.parametrize("time, zone, says", [
    ("2024-03-31 02:30", "Europe/Berlin", "'2024-03-31 02:30' does not exist in Europe/Berlin: clocks were put forward"),
    ("2011-12-30 12:00", "Pacific/Apia", "does not exist in Pacific/Apia"),
    ("2023-02-29 12:00", "UTC", "time '2023-02-29 12:00' does not exist; write it like 2024-06-21 17:30"),
    ("1900-02-29 12:00", "UTC", "does not exist"),
    ("2024-06-31 12:00", "UTC", "does not exist"),
    ("2024-06-21 24:30", "UTC", "does not exist"),
    ("noon", "UTC", "time 'noon' does not exist"),
    ("0001-01-01 00:00", "+14:00", "the sun of the year 1 is not known; give a time from 1800 to 2100"),
    ("2024-06-21 12:00", "Europe/Berln", "time zone 'Europe/Berln' is not known; use a name such as Europe/Berlin"),
    ("2024-06-21 12:00", "+25:00", r"time zone '\+25:00' is not known"),
    ("2024-06-21 12:00", "+02:75", "is not known"),
    ("2024-06-21 12:00", "../../etc/passwd", "is not known"),
    ("2024-06-21 12:00", "Europe", "is not known"),
    ("2024-06-21 23:00", "UTC", "the sun stands 12.8 degrees below the horizon at 2024-06-21 23:00 UTC; correct time"),
    ("2024-12-21 12:00", "UTC", "below the horizon"),
])
def test_times_that_are_refused(time, zone, says):
    latitude = 80 if time.startswith("2024-12") else 52.5
    with pytest.raises(InputError, match=says):
        sun_at(time, zone, latitude, 0, 0, CAMERA)


@pytest.mark.parametrize("pitch", [90, -90])
def test_camera_without_heading(pitch):
    with pytest.raises(InputError, match="straight up or down has no heading; give the light's 'direction'"):
        sun_at("2024-06-21 12:00", "UTC", 50, 0, 0, from_field_of_view(640, 480, 60, pitch=pitch))


@pytest.mark.parametrize("latitude", [-90, 90])
def test_poles(latitude):
    day = "2024-06-21" if latitude > 0 else "2024-12-21"
    found = sun_at(f"{day} 12:00", "UTC", latitude, 0, 0, CAMERA)
    # astral stops at 89.8 degrees of latitude
    assert found.elevation == pytest.approx(OBLIQUITY, abs=0.3)
