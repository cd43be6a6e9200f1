"""Mitsuba 3 scenes: XML and side files, each complete in itself."""

from __future__ import annotations

from typing import Literal
from html import escape

import numpy as np

from pipeline.errors import InputError
from pipeline.plugins.base import Exporter, parameter
from pipeline.plugins.description import emitter

HEAD = """Fog scene `{name}` ({what}) for Mitsuba 3: mitsuba -m scalar_rgb {name}.xml
Metres, right-handed, y up. Photo units: 1 is the photograph's white; linear Rec.709. The camera looks along its
own +z with x to the left. max_depth counts segments of a path: 2 is light scattered or reflected once, -1 all orders.
Point lights follow 1/d^2, ours 1/(d^2 + radius^2): they part within some radii of the bulb.
Left out: {left_out}"""


class Mitsuba(Exporter):
    """Writes `.xml` scenes for Mitsuba 3; the chain itself is rendered by POV-Ray."""

    type: Literal["mitsuba"] = "mitsuba"
    states = frozenset({"area", "point", "sun", "sunlight"})
    max_depth: int = parameter(2, "1", ge=-1, le=1000, description="segments of a path; 2 scatters once, -1 all orders")
    samples: int = parameter(256, "1", ge=1, le=1_000_000, description="a pixel")
    grid_cells: int = parameter(64, "1", ge=2, le=512, description="along each axis, where the fog is uneven")

    def scale(self, extent):
        raise InputError("Mitsuba does not render the chain", place="exporter: {type: mitsuba}",
                         remedy="leave 'exporter' out, and run: make export scene=NAME to=mitsuba")

    def export(self, name, description):
        d, files = description, {}
        fog = d.what != "clear"
        body = [f'<integrator type="volpath"><integer name="max_depth" value="{self.max_depth}"/>'
                '<integer name="rr_depth" value="1000"/></integrator>']
        if fog:
            body += self._media(name, d, files)
        body.append(self._sensor(d))
        for i, face in enumerate(d.faces):
            files[f"{name}_face{i}.obj"] = _obj(face.vertices, face.triangles)
            media = '<ref name="interior" id="fog"/><ref name="exterior" id="fog"/>' if d.what == "transmittance" else ""
            body.append(f'<!-- {escape(face.name).replace("--", "-")} -->\n{_shape(f"{name}_face{i}.obj")}'
                        f'<bsdf type="twosided"><bsdf type="diffuse">{_rgb("reflectance", d.reflectance(face))}</bsdf></bsdf>{media}</shape>')
        for i, (light, strength) in enumerate(d.lights.values()):
            body.append(self._light(f"{name}_light{i}.obj", light, strength, files))
        head = HEAD.format(name=name, what=d.what, left_out="; ".join(d.left_out) or "nothing").replace("--", "-")
        files[f"{name}.xml"] = (f'<?xml version="1.0" encoding="utf-8"?>\n<!--\n{head}\n-->\n<scene version="3.0.0">\n'
                                + "\n".join(body) + "\n</scene>\n")
        return files

    def _sensor(self, d):
        c = d.camera
        matrix = np.eye(4)
        matrix[:3, :3] = np.asarray(c.world_from_camera) @ np.diag([-1.0, -1.0, 1.0])
        matrix[:3, 3] = c.position
        cx, cy = c.principal_point
        medium = f'<ref id="{"lit_fog" if d.eye_in_shaft() else "fog"}"/>' if d.what in ("foggy", "in_scattering") else ""
        angle = float(2 * np.degrees(np.arctan(c.width / 2 / c.focal_length)))
        return (f'<sensor type="perspective"><float name="fov" value="{angle!r}"/><string name="fov_axis" value="x"/>'
                f'<float name="principal_point_offset_x" value="{float(cx / c.width - 0.5)!r}"/>'
                f'<float name="principal_point_offset_y" value="{float(cy / c.height - 0.5)!r}"/>'
                f'<float name="near_clip" value="0.001"/><float name="far_clip" value="1e7"/>'
                f'<transform name="to_world"><matrix value="{_numbers(matrix)}"/></transform>{medium}'
                f'<sampler type="independent"><integer name="sample_count" value="{self.samples}"/></sampler>'
                f'<film type="hdrfilm"><integer name="width" value="{c.width}"/><integer name="height" value="{c.height}"/>'
                '<rfilter type="box"/><string name="pixel_format" value="rgb"/></film></sensor>')

    def _media(self, name, d, files):
        absorption, scattering = d.medium.coefficients()
        extinction = absorption + scattering
        albedo = scattering / np.where(extinction > 0, extinction, 1)
        scatters = d.what in ("foggy", "in_scattering")
        density = None
        if d.medium.render_step() < np.inf:
            density = d.density(self.grid_cells)
            files[f"{name}_density.vol"] = _vol(density[..., None] * extinction / max(extinction.max(), 1e-300), d.bounds)

        def one(identity, albedo):
            if density is None:
                sigma = _rgb("sigma_t", extinction) + _rgb("albedo", albedo)
                kind = "homogeneous"
            else:
                kind = "heterogeneous"
                sigma = (f'<volume name="sigma_t" type="gridvolume"><string name="filename" value="{name}_density.vol"/>'
                         '<boolean name="use_grid_bbox" value="true"/><boolean name="raw" value="true"/></volume>'
                         f'<float name="scale" value="{float(extinction.max())!r}"/>{_rgb("albedo", albedo)}')
            return f'<medium type="{kind}" id="{identity}">{sigma}{_phase(d.medium.phase())}</medium>'

        body = [one("fog", albedo if scatters and not d.shafts else np.zeros(3))]
        files[f"{name}_bounds.obj"] = _obj(*d.border())
        body.append(f'{_shape(f"{name}_bounds.obj")}<bsdf type="null"/><ref name="interior" id="fog"/></shape>')
        if d.shafts:
            body.append(one("lit_fog", albedo))
            for i, (vertices, triangles) in enumerate(d.shafts):
                files[f"{name}_shaft{i}.obj"] = _obj(vertices, triangles)
                body.append(f'{_shape(f"{name}_shaft{i}.obj")}<bsdf type="null"/><ref name="interior" id="lit_fog"/>'
                            '<ref name="exterior" id="fog"/></shape>')
        return body

    def _light(self, file, light, strength, files):
        kind = light.type_name()
        if kind == "area":
            files[file] = _obj(*emitter(light))
            return (f'{_shape(file)}<bsdf type="diffuse">{_rgb("reflectance", np.zeros(3))}</bsdf>'
                    f'<emitter type="area">{_rgb("radiance", strength)}</emitter></shape>')
        if kind == "point":
            return (f'<emitter type="point">{_point("position", light.position.point)}{_rgb("intensity", strength)}</emitter>')
        return (f'<emitter type="directional"><vector name="direction" value="{_numbers(light.direction)}"/>'
                f'{_rgb("irradiance", strength)}</emitter>')


def _phase(phase):
    kind = phase.type_name()
    if kind == "henyey_greenstein":
        return f'<phase type="hg"><float name="g" value="{phase.asymmetry!r}"/></phase>'
    if kind in ("isotropic", "rayleigh"):
        return f'<phase type="{kind}"/>'
    raise InputError(f"Mitsuba's statement of the phase function '{kind}' is not known", place="fog.phase_function",
                     remedy="use henyey_greenstein, isotropic or rayleigh")


def _numbers(values):
    return ", ".join(repr(float(v)) for v in np.ravel(values))


def _rgb(name, colour):
    return f'<rgb name="{name}" value="{_numbers(colour)}"/>'


def _point(name, point):
    return f'<point name="{name}" value="{_numbers(point)}"/>'


def _shape(file):
    return f'<shape type="obj"><string name="filename" value="{escape(file)}"/><boolean name="face_normals" value="true"/>'


def _obj(vertices, triangles):
    return "".join("v " + " ".join(repr(float(x)) for x in v) + "\n" for v in vertices) + "".join(
        "f " + " ".join(str(int(i) + 1) for i in t) + "\n" for t in triangles)


def _vol(values, bounds):
    """Mitsuba's grid format: values (z, y, x, channels), x fastest after the channels."""
    z, y, x, channels = values.shape
    return (b"VOL\x03" + np.array([1, x, y, z, channels], "<i4").tobytes()
            + np.asarray(bounds, "<f4").tobytes() + values.astype("<f4").tobytes())
