"""Makes the neutral description that exporters state, from the placed scene, the fog and the light strengths."""

from __future__ import annotations

import numpy as np

from pipeline.geometry.shaft import shaft_hulls
from pipeline.plugins.base import Exporter, Medium, Shape
from pipeline.plugins.description import Description, Face, fan
from pipeline.plugins.lights.sun import Sun
from pipeline.scene.placed import PlacedScene

#: Share of the scene's size by which the fog's border lies beyond the walls, so that no two surfaces coincide.
MARGIN = 1e-4


#: Of a surface of which nothing is known.
ALBEDO = [0.5, 0.5, 0.5]


def describe(what: str, scene: PlacedScene, medium: Medium, strengths: dict[str, np.ndarray], lights: list[str],
             albedos: dict[str, list[float]], exporter: Exporter) -> Description:
    """One render of these lights; what the exporter cannot state is named in `left_out`.

    A sun through windows takes away the walls it comes through; its V takes away the whole room, for beyond the
    walls nothing scatters.
    """
    kept = [name for name in lights if scene.lights[name].type_name() in exporter.states]
    left_out = [f"light '{name}' ({scene.lights[name].type_name()})" for name in lights if name not in kept]
    suns = [scene.lights[name] for name in kept if isinstance(scene.lights[name], Sun)]
    if what == "foggy" and len(kept) > len(suns) and suns:
        # lamps scatter everywhere, the sun in its shafts only: one fog cannot do both
        left_out += [f"light '{name}' (sun: see its own files)" for name in kept if scene.lights[name] in suns]
        kept, suns = [name for name in kept if scene.lights[name] not in suns], []
    faces = []
    for name, shape in scene.shapes.items():
        polygons = shape.faces()
        mesh = shape.statement() if "triangles" in shape.statement() else None
        if mesh:
            faces.append(Face(f"{name}.surface", np.asarray(mesh["vertices"], float), np.asarray(mesh["triangles"]),
                              _albedo(shape, albedos, f"{name}.surface")))
            continue
        middle = np.mean([p.mean(0) for p in polygons.values()], axis=0)
        for face, corners in polygons.items():
            room = not shape.casts_shadow
            if room and suns and what == "in_scattering":
                continue
            inward = middle - corners.mean(0)
            if room and any(inward @ np.asarray(sun.direction) > 1e-9 * np.linalg.norm(inward) for sun in suns):
                continue
            # a camera outside an open box looks through its near side
            if room and inward @ (scene.camera.position - corners.mean(0)) < 0:
                continue
            faces.append(Face(f"{name}.{face}", corners, fan(len(corners)), _albedo(shape, albedos, f"{name}.{face}")))
    points = np.concatenate([c for _, c in scene.faces()] + [f.vertices for f in faces]
                            + [p for p in (light.emitting_polygon() for light in scene.lights.values()) if p is not None]
                            + [scene.camera.position[None]])
    margin = MARGIN * np.ptp(points, axis=0).max()
    bounds = np.stack([points.min(0) - margin, points.max(0) + margin])
    shafts = []
    if what != "transmittance":
        shafts = [(hull.vertices, hull.triangles) for sun in suns for name, opening in sun.openings.items()
                  for hull in shaft_hulls(opening.window.polygon, [p.polygon for p in opening.patches], name)]
    return Description(what, scene.camera, faces, {name: (scene.lights[name], strengths[name]) for name in kept},
                       medium, bounds, shafts, left_out)


def _albedo(shape: Shape, albedos: dict[str, list[float]], face: str) -> np.ndarray:
    """Diffuse albedo (3,) of a face: as estimated, else as stated."""
    return np.array(albedos.get(face, shape.albedo or ALBEDO))
