"""pbrt-v4 scenes: one `.pbrt` file each, complete in itself."""

from __future__ import annotations

from typing import Literal

import numpy as np

from pipeline.errors import InputError
from pipeline.plugins.base import Exporter, parameter
from pipeline.plugins.description import emitter

HEAD = """# Fog scene `{name}` ({what}) for pbrt-v4: pbrt {name}.pbrt
# Metres, y up; photo units: 1 is the photograph's white; linear Rec.709. The camera's matrix leads from the world,
# right-handed, to pbrt's camera, left-handed: x right, y up, z forward. The film's exposure time and ISO are such that
# its values are radiance. maxdepth 1 is light scattered or reflected once; raise it for all orders.
# A transmittance scene divided by the clear one of the same light is T, eye path included.
# Left out: {left_out}
"""


class Pbrt(Exporter):
    """Writes `.pbrt` scenes for pbrt-v4; the chain itself is rendered by POV-Ray."""

    type: Literal["pbrt"] = "pbrt"
    states = frozenset({"area", "point", "spot", "sun", "sunlight"})
    max_depth: int = parameter(1, "1", ge=0, le=1000, description="scatterings of a path; 1 scatters once")
    samples: int = parameter(256, "1", ge=1, le=1_000_000, description="a pixel")
    grid_cells: int = parameter(48, "1", ge=2, le=256, description="along each axis, where the fog is uneven")

    def scale(self, extent):
        raise InputError("pbrt does not render the chain", place="exporter: {type: pbrt}",
                         remedy="leave 'exporter' out, and run: make export scene=NAME to=pbrt")

    def export(self, name, description):
        d = description
        fog = d.what != "clear"
        lines = [HEAD.format(name=name, what=d.what, left_out="; ".join(d.left_out) or "nothing"),
                 f'Integrator "volpath" "integer maxdepth" [ {self.max_depth} ]',
                 f'Sampler "independent" "integer pixelsamples" [ {self.samples} ]',
                 'PixelFilter "box" "float xradius" [ 0.5 ] "float yradius" [ 0.5 ]',
                 f'Film "rgb" "string filename" [ "{name}.exr" ] "integer xresolution" [ {d.camera.width} ]'
                 f' "integer yresolution" [ {d.camera.height} ] "string sensor" [ "cie1931" ] "float iso" [ 100 ]',
                 'ColorSpace "srgb"', *([*self._media(d), f'MediumInterface "" "{"lit_fog" if d.eye_in_shaft() else "fog"}"'] if fog else []),
                 *self._camera(d.camera), "WorldBegin"]
        if fog and any(_is_sun(light) for light, _ in d.lights.values()):
            # light from afar enters the fog at its border
            lines += _border("fog", "", *d.border())
        for hull in d.shafts if fog else ():
            lines += _border("lit_fog", "fog", *hull)
        if fog:
            lines.append('MediumInterface "" "fog"')
        for face in d.faces:
            lines += [f"# {face.name}", "AttributeBegin",
                      f'  Material "diffuse" "rgb reflectance" [ {_numbers(d.reflectance(face))} ]',
                      f"  {_mesh(face.vertices, face.triangles)}", "AttributeEnd"]
        for light, strength in d.lights.values():
            lines += ["AttributeBegin", *(f"  {line}" for line in self._light(light, strength)), "AttributeEnd"]
        return {f"{name}.pbrt": "\n".join(lines) + "\n"}

    def _camera(self, c):
        right, down, forward = np.asarray(c.world_from_camera).T
        to_camera = np.eye(4)
        to_camera[:3, :3] = [right, -down, forward]
        to_camera[:3, 3] = -to_camera[:3, :3] @ c.position
        (cx, cy), f = c.principal_point, c.focal_length
        window = [-cx / f, (c.width - cx) / f, -(c.height - cy) / f, cy / f]
        # pbrt reads matrices column by column; 90 degrees make the window's unit the tangent
        return [f"Transform [ {_numbers(to_camera.T)} ]",
                f'Camera "perspective" "float fov" [ 90 ] "float screenwindow" [ {_numbers(window)} ]']

    def _media(self, d):
        absorption, scattering = d.medium.coefficients()
        dark = self._medium(d, "fog", absorption + scattering, np.zeros(3))
        if d.what == "transmittance":
            return [dark]
        if d.shafts:
            return [dark, self._medium(d, "lit_fog", absorption, scattering)]
        return [self._medium(d, "fog", absorption, scattering)]

    def _medium(self, d, name, absorption, scattering):
        phase = d.medium.phase()
        if phase.type_name() not in ("henyey_greenstein", "isotropic"):
            raise InputError(f"pbrt knows no phase function '{phase.type_name()}'", place="fog.phase_function",
                             remedy="use henyey_greenstein or isotropic, or export to mitsuba")
        g = getattr(phase, "asymmetry", 0.0)
        sigma = (f'"rgb sigma_a" [ {_numbers(absorption)} ] "rgb sigma_s" [ {_numbers(scattering)} ] "float g" [ {g!r} ]'
                 ' "float scale" [ 1 ]')
        if d.medium.render_step() == np.inf:
            return f'MakeNamedMedium "{name}" "string type" [ "homogeneous" ] {sigma}'
        n, density = self.grid_cells, d.density(self.grid_cells)
        return (f'MakeNamedMedium "{name}" "string type" [ "uniformgrid" ] {sigma} "integer nx" [ {n} ] "integer ny" [ {n} ]'
                f' "integer nz" [ {n} ] "point3 p0" [ {_numbers(d.bounds[0])} ] "point3 p1" [ {_numbers(d.bounds[1])} ]'
                f' "float density" [ {" ".join(f"{v:.6g}" for v in density.ravel())} ]')

    def _light(self, light, strength):
        kind = light.type_name()
        if kind == "area":
            return ['Material "diffuse" "rgb reflectance" [ 0 0 0 ]',
                    f'AreaLightSource "diffuse" "rgb L" [ {_numbers(strength)} ] "bool twosided" [ false ]',
                    _mesh(*emitter(light))]
        if kind == "point":
            return [f'LightSource "point" "point3 from" [ {_numbers(light.position.point)} ] "rgb I" [ {_numbers(strength)} ]']
        if _is_sun(light):
            return [f'LightSource "distant" "point3 from" [ 0 0 0 ] "point3 to" [ {_numbers(light.direction)} ]'
                    f' "rgb L" [ {_numbers(strength)} ]']
        # pbrt's falloff is a smoothstep of the cosine, as ours is
        return [f'LightSource "spot" "point3 from" [ {_numbers(light.position.point)} ]'
                f' "point3 to" [ {_numbers(light.target.point)} ] "float coneangle" [ {light.outer_angle!r} ]'
                f' "float conedeltaangle" [ {light.outer_angle - light.inner_angle!r} ] "rgb I" [ {_numbers(strength)} ]']


def _is_sun(light) -> bool:
    return light.type_name() in ("sun", "sunlight")


def _border(inside: str, outside: str, vertices, triangles) -> list[str]:
    """A surface that only parts two media."""
    return ["AttributeBegin", f'  MediumInterface "{inside}" "{outside}"', '  Material "interface"',
            f"  {_mesh(vertices, triangles)}", "AttributeEnd"]


def _numbers(values) -> str:
    return " ".join(repr(float(v)) for v in np.ravel(values))


def _mesh(vertices, triangles) -> str:
    indices = " ".join(str(int(i)) for i in np.ravel(triangles))
    return f'Shape "trianglemesh" "integer indices" [ {indices} ] "point3 P" [ {_numbers(vertices)} ]'
