"""Renders and light strengths -> transmittance.exr, in_scattering_LIGHT.exr, in_scattering.exr."""

from __future__ import annotations

import numpy as np

from pipeline.imaging.maps import read_map, write_map
from pipeline.paths import Build
from pipeline.geometry.visibility import visible
from pipeline.physics.composition import combined_transmittance
from pipeline.physics.upsampling import upsample
from pipeline.rendering.runs import from_json
from pipeline.scene.artefacts import fog_metadata, read_fog, read_json, read_placed, read_strengths, write_json

#: Below this a half float of POV-Ray has lost digits; the closed form stands in.
FEWEST_DIGITS = 6e-4


def run(build: Build) -> None:
    plan, scene, medium = read_json(build.plan), read_placed(build), read_fog(build)
    strengths = read_strengths(build)
    runs = {data["id"]: from_json(data) for data in plan["runs"]}
    metadata = fog_metadata(build, medium)
    depth = read_map(build.depth).astype(float)
    size = depth.shape

    def image(run_id: str) -> tuple[np.ndarray, float]:
        return read_map(build.runs / f"{run_id}.exr").astype(float), runs[run_id].exposure

    camera = scene.camera
    points = camera.position + depth[..., None] * camera.directions(camera.pixel_centres())
    eye = np.exp(-medium.optical_depth(camera.position, points))
    surfaces = read_map(build.surfaces)
    extinction = np.add(*medium.coefficients())
    clear, reduced, indirect, indirect_reduced, weights = [], [], [], [], []
    for light in plan["lights"]:
        basis = read_map(build.basis / f"irradiance_{light}.exr").astype(float)
        exposure = read_json(build.basis / "runs.json")[f"irradiance_{light}"]["exposure"]
        fogged, fog_exposure = image(f"transmittance_{light}")
        entry = np.exp(-extinction * scene.lights[light].entry_path(points)[..., None])
        irradiance, path = scene.lights[light].incident(points)
        on_the_way = np.exp(-extinction * path[..., None])
        d = basis / exposure
        closed_form = d * eye * on_the_way
        digits = (fogged > FEWEST_DIGITS) & (basis > FEWEST_DIGITS)
        clear.append(d)
        reduced.append(np.where(digits, np.minimum(fogged / fog_exposure, d) * entry, closed_form))
        indirect.append(np.broadcast_to(irradiance[..., None] / np.pi, (*size, 3)))
        indirect_reduced.append(indirect[-1] * eye * on_the_way)
        weights.append(strengths[light])
    transmittance = combined_transmittance(eye, clear, reduced, indirect, indirect_reduced, weights)
    transmittance = np.where((surfaces[..., 1] >= 0)[..., None], eye, transmittance)
    write_map(build.transmittance, transmittance.astype(np.float32), {**metadata, "fog:content": "transmittance map T"})

    total = np.zeros((*size, 3))
    written = []
    for light in plan["lights"]:
        if f"in_scattering_{light}" in runs:
            rendered, exposure = image(f"in_scattering_{light}")
            if rendered.shape[:2] != size:
                coarse = camera.resized(rendered.shape[1], rendered.shape[0])
                rendered = upsample(rendered, visible(coarse, scene.shapes, scene.lights)[0], depth)
            one = strengths[light] * rendered / exposure
        else:
            one = np.zeros((*size, 3))
        total += one
        written.append(build.in_scattering(light))
        write_map(written[-1], one.astype(np.float32), {**metadata, "fog:content": f"in-scattering V of {light}"})
    write_map(build.in_scattering(), total.astype(np.float32), {**metadata, "fog:content": "in-scattering map V"})
    for old in build.out.glob("in_scattering_*.exr"):
        if old not in written:
            old.unlink()
    write_json(build.maps, {
        "transmittance_median": float(np.median(transmittance)), "in_scattering_median": float(np.median(total)),
        "lights": plan["lights"]})
