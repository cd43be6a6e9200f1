"""The typed scene file. Everything a person can say about a photograph stands here or in a plugin."""

from typing import Annotated, Any, Literal

from pydantic import Field, StringConstraints, model_validator

from pipeline.plugins.base import Finite, FogName, Model, Name, Pixel, Vector, mistake, parameter
from pipeline.plugins.choices import choice
from pipeline.scene.depth_section import DepthSection

#: Of all lights together; each costs a term at every point of the fog.
MOST_SMALL_LIGHTS = 20_000
Axis = Literal["x", "y", "z"]
FileName = Annotated[str, StringConstraints(min_length=1, max_length=200)]
Segment = Annotated[list[Pixel], Field(min_length=2, max_length=2)]


class PhotographFile(Model):
    """The clear photograph."""

    file: FileName = parameter(description="in the scene's folder; JPEG, PNG, TIFF, EXR or HDR")
    colour_space: Literal["auto", "srgb", "linear", "display_p3", "adobe_rgb"] = parameter(
        "auto",
        description="auto: an embedded ICC profile, else sRGB for integer files and linear for float files")
    size: int | None = parameter(
        None, "pixel", ge=1, le=20000,
        description="longer side to which it is resampled first; only where nothing is annotated in its pixels")
    working_size: int | None = parameter(
        1024, "pixel", ge=64, le=20000,
        description="longer side at which light and fog of a larger photograph are worked out; null for its own")
    max_megapixels: float = parameter(100.0, "megapixel", gt=0, le=2000,
                                      description="larger files are refused")


class KnownLength(Model):
    """One length in the photograph that is known in metres; sets the scale instead of the camera's height."""

    pixels: Segment = parameter(unit="pixel", description="its two ends")
    on: Literal["floor"] = parameter("floor", description="plane on which both ends lie")
    length: float = parameter(unit="m", ge=1e-6, le=1e6)


class CameraDescription(Model):
    """The camera: by lines along the room's edges, by angles, by fSpy, or directly in the world."""

    lines: dict[Axis, Annotated[list[Segment], Field(min_length=1, max_length=100)]] | None = parameter(
        None, "pixel",
        description="segments along edges that run left-right (x), vertically (y), front-back (z)")
    fspy: FileName | None = parameter(None, description="JSON exported by fSpy, in the scene's folder")
    horizontal_field_of_view: float | None = parameter(None, "degree", gt=0.1, lt=179)
    focal_length_35mm: float | None = parameter(None, "mm", gt=1, le=10000,
                                                description="35 mm equivalent; EXIF's when left out")
    yaw: Finite | None = parameter(None, "degree", description="to the right of looking along -z")
    pitch: Finite | None = parameter(None, "degree", description="upwards")
    roll: Finite | None = parameter(None, "degree", description="clockwise")
    principal_point: Pixel | Literal["estimate"] | None = parameter(
        None, "pixel", description="the centre when left out")
    horizon: Segment | None = parameter(
        None, "pixel", description="a line along the horizon, instead of `pitch` and `roll`")
    height: float | None = parameter(None, "m", ge=1e-6, le=1e6, description="of the camera above the floor")
    known_length: KnownLength | None = None
    position: Vector | None = parameter(None, "m", description="with `look_at`: the camera in the world")
    look_at: Vector | None = parameter(None, "m")

    @model_validator(mode="after")
    def _ways(self):
        if (self.position is None) != (self.look_at is None):
            raise mistake("only one of 'position' and 'look_at' is there", "give both")
        if self.position is None and (self.height is None) == (self.known_length is None):
            both = "both 'height' and 'known_length' set the scale"
            raise mistake("no scale" if self.height is None else both,
                          "give one of 'height' [m] and 'known_length'")
        told = self.height, self.known_length, self.yaw, self.pitch
        if self.position is not None and any(value is not None for value in told):
            raise mistake("'position' and 'look_at' already say what 'height', 'known_length', 'yaw' or"
                          " 'pitch' do", "leave those out, or 'position' and 'look_at'")
        if self.horizon is not None and (self.lines or self.fspy or self.position is not None
                                         or self.pitch is not None or self.roll is not None):
            raise mistake("'horizon' says what 'pitch', 'roll', 'lines', 'fspy' or 'position' do",
                          "keep one of them", at=("horizon",))
        if self.fspy and self.lines:
            raise mistake("both 'fspy' and 'lines' tell the camera", "keep one of them")
        if self.position is not None and (self.lines or self.fspy):
            raise mistake("'position' and 'look_at' contradict 'lines' or 'fspy'",
                          "leave out 'lines' and 'fspy', or give 'height' instead of 'position' and"
                          " 'look_at'")
        return self


class RenderSettings(Model):
    """How accurate the foggy photograph is to be, and what else concerns the renders.

    Knobs that are left out, or null, are chosen by what `tolerance`, `budget` or `quality` asks; one that is stated holds.
    """

    quality: Literal["draft", "normal", "final"] = parameter(
        "normal", description="draft to look at, normal to use, final to measure: a tolerance of 0.05, 0.01 or 0.002, for"
                              " which the plan picks the cheapest renders")
    tolerance: Annotated[float, Field(ge=1e-4, le=1)] | None = parameter(
        None, "1", description="relative error of the foggy photograph to stay below, instead of `quality`")
    budget: Annotated[float, Field(ge=0.1, le=86400)] | None = parameter(
        None, "s", description="time for the fog, of a photograph whose light is known, in which the smallest error is"
                               " wanted; instead of `quality` and `tolerance`")
    samples: Annotated[int, Field(ge=1, le=10000)] | None = parameter(
        None, "1", description="points along each ray where fog is lit; more for dense fog")
    in_scattering_size: Annotated[int, Field(ge=16, le=20000)] | None = parameter(
        None, "pixel", description="longer side at which the glow of lamps is found; 20000 is any photograph's own")
    glow_tolerance: Annotated[float, Field(ge=1e-5, le=0.5)] | None = parameter(
        None, "1", description="relative change at which the integral of an area light's glow is fine enough")
    shadow_size: Annotated[int, Field(ge=16, le=20000)] | None = parameter(
        None, "pixel",
        description="longer side at which renders tell what shadows take from a glow")
    shadow_lights: Annotated[int, Field(ge=1, le=32)] | None = parameter(
        None, "1", description="its square is the most small lights that stand for an area light in those renders")
    shaft_samples: Annotated[int, Field(ge=1, le=10000)] | None = parameter(
        None, "1", description="points along each ray in a shaft of sunlight, or in a single lamp's glow; three times"
                                    " `samples` where only that is stated")
    transmittance: Literal["area", "integrated", "midpoint"] | None = parameter(
        None, description="of a lamp's light on its way to surfaces: rendered over its area, as half-shadows in dense"
                               " fog need it; averaged over its area without a render; or from its midpoint, as in the"
                               " paper (eq. 5)")
    transmittance_size: Annotated[int, Field(ge=16, le=20000)] | None = parameter(
        None, "pixel", description="longer side at which the light's way to surfaces is rendered; 20000 is any photograph's"
                                   " own")
    transmittance_step: Annotated[float, Field(gt=1e-3, le=100)] | None = parameter(
        None, "1", description="optical depth that a small part of a lamp may span for T; smaller is more accurate in"
                                    " half-shadows in dense fog")
    room_directions: Annotated[int, Field(ge=16, le=128)] | None = parameter(
        None, "1", description="along which points in a room see what its surfaces throw back, for light of all orders")
    glow: Literal["integrated", "rendered"] = parameter(
        "integrated", description="of area lights: integrated over the area, renders saying what shadows take; or all of it"
                                  " rendered, so that edits of templates/lights/area.inc show in it (always where a"
                                  " template is not as it came)")
    checked_pixels: Annotated[int, Field(ge=0, le=10000)] | None = parameter(
        None, "1", description="made as finely as it takes, to estimate the error of all: 48 for draft, 160 for normal, 320"
                               " for final quality when left out; 0 for no estimate")
    threads: int | None = parameter(None, "1", ge=1, le=512,
                                    description="POV-Ray's work threads; all cores when left out")
    max_light_samples: float = parameter(
        1e11, "1", ge=1, le=1e15, description="scenes that need more are refused before they are rendered: pixels, times"
                                              " samples, times the small lights that stand for each light")
    timeout: float = parameter(1800.0, "s", gt=0, le=86400,
                               description="a single POV-Ray run that takes longer is stopped")


class CompositeSettings(Model):
    """How the foggy photograph is put together from T and V; a change renders nothing."""

    exposure: float = parameter(
        0.0, "EV", ge=-20, le=20, description="stops by which the foggy photograph is brighter, as if exposed for it")
    restore_clipped_lamps: bool = parameter(
        True,
        description="gives burnt-out pixels of lamps their estimated radiance, so that fog does not turn"
                    " them grey")


def first_in_pixels(value: Any, at: tuple = ()) -> tuple | None:
    """Keys of the first value below `value` that refers to the photograph's pixels, or None."""
    if isinstance(value, dict):
        parts = [(key, one, "") for key, one in value.items()]
    elif isinstance(value, list):
        parts = [(index, one, "") for index, one in enumerate(value)]
    elif isinstance(value, Model):
        parts = [(name, getattr(value, name), (field.json_schema_extra or {}).get("unit", ""))
                 for name, field in type(value).model_fields.items()]
    else:
        return None
    for key, one, unit in parts:
        found = (*at, key) if unit == "pixel" and isinstance(one, (list, dict)) and one else (
            first_in_pixels(one, (*at, key)))
        if found:
            return found
    return None


def scene_model() -> type[Model]:
    """The scene file's model, over all plugins registered now."""
    Shape, Light, Medium, Exporter = (choice(kind) for kind in ("shapes", "lights", "media", "exporters"))
    Illumination, SunDirection = (choice("estimators", what) for what in ("illumination", "sun_direction"))

    class Scene(Model):
        """A photograph, its camera, geometry and lights, and one or more fogs."""

        photograph: PhotographFile
        camera: CameraDescription
        depth: DepthSection | None = parameter(
            None, description="in the open air: how far the photograph's regions are")
        shapes: dict[Name, Shape] = parameter(
            {}, description="solid things, in an order in which each stands on earlier ones", max_length=500)
        lights: dict[Name, Light] = parameter(..., description="lamps, windows, the sun", min_length=1,
                                              max_length=500)
        illumination: Illumination = parameter({"type": "karsch"},
                                               description="how light strengths are found")
        sun_direction: SunDirection = parameter({"type": "window_patches"},
                                                description="how the sun's direction is found")
        fog: Medium = parameter(description="the fog")
        fogs: dict[FogName, Medium] = parameter({}, description="further fogs; `fog=NAME` picks one",
                                             max_length=500)
        render: RenderSettings = RenderSettings()
        composite: CompositeSettings = CompositeSettings()
        exporter: Exporter = parameter({"type": "povray"}, description="renderer's language")

        @model_validator(mode="after")
        def _known_strengths(self):
            if self.illumination.type == "manual":
                for name, l in self.lights.items():
                    if l.given_strength() is None and l.type not in ("ambient", "ground"):
                        raise mistake(f"no {l.strength_name}, and illumination is manual",
                                      f"add '{l.strength_name}:', or choose illumination type karsch",
                                      ("lights", name))
            if not self.shapes and self.depth is None:
                raise mistake("neither 'shapes' nor 'depth' is there",
                              "describe a room by 'shapes', the open air by 'depth'")
            if self.photograph.size is not None:
                parts = {"camera": self.camera, "shapes": self.shapes, "lights": self.lights,
                         "illumination": self.illumination}
                whole = [("depth",)] * (self.depth is not None) + [("camera", "fspy")] * (self.camera.fspy is not None)
                at = next(iter(whole), None) or first_in_pixels(parts)
                if at:
                    raise mistake(f"photograph.size = {self.photograph.size} would move what is annotated in pixels",
                                  "leave 'photograph.size' out, or state it in metres", at)
            small = sum(l.sub_lights**2 if hasattr(l, "sub_lights") else len(getattr(l, "positions", [0]))
                        for l in self.lights.values())
            if small > MOST_SMALL_LIGHTS:
                raise mistake(f"{small} small lights (lamps' positions, squares of sub_lights), more than {MOST_SMALL_LIGHTS}",
                              "lower sub_lights or leave lamps out; this limit is fixed, as scene files may come from"
                              " strangers", ("lights",))
            if sum(l.type == "sun" for l in self.lights.values()) > 1:
                raise mistake("more than one light of type sun", "put the openings of all windows into one",
                              ("lights",))
            return self

    return Scene


def json_schema() -> dict[str, Any]:
    """JSON Schema of the scene file, for editors."""
    schema = scene_model().model_json_schema()
    for group in [schema, *schema["$defs"].values()]:
        for part in group["properties"].values():
            if "patternProperties" in part:
                part["additionalProperties"] = False  # other names are refused
    for definition in schema["$defs"].values():
        if "const" in definition.get("properties", {}).get("type", {}):  # a plugin, which is told by its type
            definition["required"] = ["type", *definition.get("required", [])]
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "Fog scene"
    return schema
