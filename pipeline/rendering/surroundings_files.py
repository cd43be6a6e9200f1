"""What stands round the fog, as the illumination stage finds it and keeps it in basis/ for all fogs of a scene."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from pipeline.estimation.fog_surroundings import DIRECTIONS, FogSurroundings, about, axis_of, every, fog_surroundings
from pipeline.estimation.room_light import VIEW_DIRECTIONS, RoomLight, before, room_light, sight, sphere
from pipeline.estimation.surroundings import Surroundings
from pipeline.geometry.camera import Camera
from pipeline.geometry.lattice import Lattice
from pipeline.geometry.patches import Patches, areas_and_normals
from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.plugins.base import Light
from pipeline.scene.artefacts import read_json
from pipeline.scene.placed import PlacedScene

#: Rows: points in the fog, along a grid of eye rays; columns: directions over the sphere.
CONTENT = "what points in the fog (rows) see along directions (columns): radiance of ground and things"
SEEN = "what points in the fog (rows) see along directions (columns): 0 sky, 1 ground, 2 things; distance in m; index of the face"
#: Rows: points of the room, then patches of its surfaces.
ROOM = "what points in a room, then patches of its surfaces (rows) see along directions (columns): radiance"
HITS = "what points in a room, then patches of its surfaces (rows) see along directions (columns): 0; distance in m; index of the face"
PLACES = "points in a room, then patches of its surfaces (rows): position in m, normal, which lamps reach it (red)"
#: Of nothing, in a file.
NOWHERE = 1e30


def asks(scene: PlacedScene, light: Light, source: str) -> bool:
    """Whether things round the fog matter to a light. A sky in a room is none of the open air's; an ambient radiance that a
    person states is what they say, everywhere."""
    if light.comes_from is None or light.unobstructed:
        return False
    return source != "given" if light.comes_from == "all" else scene.outdoors


def lamps_of(scene: PlacedScene) -> dict[str, Light]:
    """Lights that reach fog and surfaces from a place of their own."""
    return {name: light for name, light in scene.lights.items()
            if light.comes_from is None and light.reaching(scene.camera.position[None]) is not None}


def write_surroundings(build: Build, scene: PlacedScene, lights: dict[str, dict], lamps: np.ndarray, share: float = 1.0
                       ) -> dict | None:
    """Writes what the fog of a scene sees round it where a light asks for that; what the readers below need, else None.

    lights: what was estimated of each, and the `source` of that. lamps (H, W): pixels of the photograph that show lamps.
    share: as `fog_surroundings`.
    """
    asking = [light for name, light in scene.lights.items() if asks(scene, light, lights[name]["source"])]
    found = room = None
    if asking:
        photograph = np.maximum(read_map(build.photograph).astype(float), 0)
        depth, face = read_map(build.depth).astype(float), read_map(build.surfaces)[..., 0].astype(int)
        around = Surroundings(scene.camera, scene.first_hit, photograph, depth, face, lamps)
        # in the open air the photograph shows what arrives of the sun and the sky: fog takes nothing of that
        triangles, indoors = scene.triangle_count(), not scene.outdoors and bool(lamps_of(scene))
        found = fog_surroundings(scene.camera, around, read_json(build.geometry).get("ground_faces", []), triangles, share,
                                 VIEW_DIRECTIONS if indoors else DIRECTIONS, indoors)
        if found is not None and indoors:
            strengths = {name: np.asarray(one["strength"], float) for name, one in lights.items()}
            found, room = room_light(scene.camera, around, found, [corners for _, corners in scene.faces()], lamps_of(scene),
                                     strengths, triangles, share)
    for path in (build.surroundings, build.surrounding_hits):
        if found is None:
            path.unlink(missing_ok=True)
    for path in (build.room, build.room_hits, build.room_places):
        if room is None:
            path.unlink(missing_ok=True)
    if found is None:
        return None
    _write(build.surroundings, found.radiance.reshape(-1, *found.radiance.shape[3:]), CONTENT)
    _write(build.surrounding_hits, _hits(found.kind, found.reach, found.face).reshape(-1, found.kind.shape[-1], 3), SEEN)
    return {"rays": list(found.kind.shape[:2]), "distances_m": found.distances.tolist(),
            "sky_seen": found.sky_seen() if scene.outdoors else None, "mean_radiance": around.overall.tolist(),
            "room": None if room is None else _write_room(build, room)}


def read_surroundings(build: Build, camera: Camera) -> FogSurroundings | None:
    facts = read_json(build.illumination).get("surroundings")
    if not facts:
        return None
    distances = np.asarray(facts["distances_m"])
    shape = (*facts["rays"], len(distances), -1)
    kind, reach, face = (one.reshape(shape) for one in _read_hits(build.surrounding_hits))
    radiance = read_map(build.surroundings).astype(float).reshape(*shape, 3)
    return FogSurroundings(distances, kind, radiance, reach, face, *about(axis_of(camera), kind.shape[-1]))


def surrounded(build: Build, scene: PlacedScene, lights: Iterable[str]) -> list[str]:
    """Those of the lights whose V what stands round the fog changes."""
    facts = read_json(build.illumination)
    return [name for name in lights
            if facts.get("surroundings") and asks(scene, scene.lights[name], facts["lights"][name]["source"])]


def is_room(build: Build, scene: PlacedScene, lights: Iterable[str]) -> bool:
    """Whether one of the lights is all that a room reflects, which each of its fogs changes."""
    facts = read_json(build.illumination).get("surroundings") or {}
    return bool(facts.get("room")) and any(scene.lights[name].comes_from == "all" for name in surrounded(build, scene, lights))


def read_room(build: Build, scene: PlacedScene, directions: int) -> RoomLight | None:
    """directions: from each point, about so many of those that were found are taken."""
    facts = (read_json(build.illumination).get("surroundings") or {}).get("room")
    if not facts:
        return None
    count, places = facts["points"], read_map(build.room_places).astype(float)
    patches = Patches(places[count:, 0], places[count:, 1], facts["spacing_m"])
    low, high = np.asarray(facts["box_m"])
    within = Lattice(places[:count, 0], low, high, np.asarray(facts["cells"]))
    normals = areas_and_normals([corners for _, corners in scene.faces()])[1]
    radiance, (_, reach, face) = read_map(build.room).astype(float), _read_hits(build.room_hits)
    each, taken = reach.shape[1], every(reach.shape[1], directions)

    def seen(part: slice, points: np.ndarray, directions: np.ndarray):
        of_part = (slice(part.start, part.stop), taken)
        weights = np.full(reach[of_part].shape, 1 / reach[of_part].shape[1])
        return sight(points, directions[:, taken], weights, reach[of_part], radiance[of_part], face[of_part], normals, patches)

    return RoomLight(within, seen(slice(count), within.points, np.broadcast_to(sphere(each), (count, each, 3))),
                     patches, seen(slice(count, None), patches.points, before(patches, each)),
                     {name: places[count:, 2 + i, 0] for i, name in enumerate(facts["lamps"])}, face)


def _write_room(build: Build, room: RoomLight) -> dict[str, Any]:
    sights = room.within, room.beside
    _write(build.room, np.concatenate([one.radiance for one in sights]), ROOM)
    _write(build.room_hits, _hits(np.zeros(room.faces.shape), np.concatenate([one.reach for one in sights]), room.faces), HITS)
    points = np.concatenate([room.lattice.points, room.patches.points])
    places = np.zeros((len(points), 2 + len(room.unhidden), 3))
    places[:, 0], first = points, len(room.lattice.points)
    places[first:, 1] = room.patches.normals
    for i, free in enumerate(room.unhidden.values()):
        places[first:, 2 + i, 0] = free
    _write(build.room_places, places, PLACES)
    return {"points": first, "patches": len(room.patches.points), "spacing_m": room.patches.spacing,
            "box_m": [room.lattice.low.tolist(), room.lattice.high.tolist()], "cells": room.lattice.counts.tolist(),
            "lamps": list(room.unhidden)}


def _write(path, values: np.ndarray, content: str) -> None:
    write_map(path, values, {"fog:content": content})


def _hits(kind: np.ndarray, reach: np.ndarray, face: np.ndarray) -> np.ndarray:
    return np.stack([kind, np.minimum(reach, NOWHERE), face], -1)


def _read_hits(path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kind, reach, face = np.moveaxis(read_map(path).astype(float), -1, 0)
    return np.round(kind).astype(int), np.where(reach < NOWHERE / 2, reach, np.inf), np.round(face).astype(int)
