"""The scene file's `depth` section: what the photograph's regions are, or a depth map that exists."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, StringConstraints, model_validator

from pipeline.errors import nearest
from pipeline.plugins.base import Model, Name, Pixel, mistake, parameter

FileName = Annotated[str, StringConstraints(min_length=1, max_length=200)]
Outline = Annotated[list[Pixel], Field(min_length=3, max_length=2000)]


class RegionDescription(Model):
    """A part of the photograph that is ground, stands upright, or is open sky (Hoiem et al. 2007)."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, strict=True,
                              populate_by_name=True)

    surface: Literal["support", "vertical", "sky"] = parameter(
        alias="class", description="ground, lawns, roads, water; or walls, trees, people; or sky")
    pixels: Outline | None = parameter(None, "pixel", description="its outline")
    holes: Annotated[list[Outline], Field(max_length=200)] = parameter([], "pixel", description="outlines cut out of it")
    label: Annotated[str, StringConstraints(pattern=r"^#[0-9a-fA-F]{6}$")] | None = parameter(
        None, description="its colour in the label image, instead of `pixels`")
    foot: Annotated[list[Pixel], Field(min_length=2, max_length=100)] | None = parameter(
        None, "pixel", description="line on which it stands on the ground; upright walls rise from it")
    depth: float | None = parameter(None, "m", ge=1e-6, le=1e7, description="distance, where it is known or guessed")
    near: float | None = parameter(None, "m", ge=1e-6, le=1e7, description="of ground: distance at its lowest row")
    far: float | None = parameter(None, "m", ge=1e-6, le=1e7, description="of ground: distance at its highest row")
    porous: bool = parameter(False, description="whether what lies behind shows through it: branches, lattices")
    thickness: float | None = parameter(
        None, "m", ge=0, le=1e5, description="how deep it is behind what is seen, for the shadow that it throws;"
                                              " a third of its width when left out")

    @model_validator(mode="before")
    @classmethod
    def _no_unread_keys(cls, data):
        known = ["class", *(name for name in cls.model_fields if name != "surface")]
        for key in data if isinstance(data, dict) else ():
            if key not in known and key != "surface":
                raise mistake("unknown key", f"use one of {', '.join(known)}" + nearest(str(key), known), at=(key,))
        return data

    @model_validator(mode="after")
    def _consistent(self):
        if (self.pixels is None) == (self.label is None):
            raise mistake("both 'pixels' and 'label' are there" if self.pixels else "no outline",
                          "give either 'pixels' or, with a label image, 'label'")
        if self.holes and self.pixels is None:
            raise mistake("'holes' are cut out of 'pixels'", "leave holes unpainted in the label image", at=("holes",))
        upright, ground = self.surface == "vertical", self.surface == "support"
        for key, fits in {"foot": upright, "depth": upright, "thickness": upright, "porous": upright, "near": ground,
                          "far": ground}.items():
            if getattr(self, key) not in (None, False) and not fits:
                raise mistake(f"'{key}' has no meaning for a region of class {self.surface}", "leave it out",
                              at=(key,))
        if self.foot is not None and self.depth is not None:
            raise mistake("both 'foot' and 'depth' say how far it is", "keep one of them", at=("depth",))
        if (self.near is None) != (self.far is None):
            raise mistake("'near' and 'far' go together", "give both, or none for the level ground")
        if self.near is not None and not self.near < self.far:
            raise mistake(f"near {self.near} is not below far {self.far}", "give a near below far [m]",
                          at=("near",))
        return self


class DepthMap(Model):
    """A depth map of the photograph from elsewhere."""

    file: FileName = parameter(description="in the scene's folder; PNG, TIFF or EXR of one channel")
    kind: Literal["planar", "radial", "disparity"] = parameter(
        "planar", description="along the camera's axis, along the ray, or stereo disparity [pixel]")
    metres_per_unit: float | None = parameter(
        None, "m", ge=1e-6, le=1e6, description="of depth; 0.001 for 16-bit files, 1 for float ones when left out")
    baseline: float | None = parameter(None, "m", ge=1e-6, le=1e4, description="between the cameras, with disparity")
    focal_length: float | None = parameter(
        None, "pixel", gt=0, le=1e7, description="of the map's own camera at the map's size; the photograph's"
                                                 " when left out")
    principal_point: Pixel | None = parameter(None, "pixel", description="of the map's own camera, as above")

    @model_validator(mode="after")
    def _stereo(self):
        if (self.kind == "disparity") != (self.baseline is not None):
            raise mistake("'baseline' goes with kind disparity",
                          "add 'baseline' [m]" if self.baseline is None else "leave out 'baseline'")
        if self.kind == "disparity" and self.metres_per_unit is not None:
            raise mistake("disparity is in pixels", "leave out 'metres_per_unit'", at=("metres_per_unit",))
        return self


class Refinement(Model):
    """How borders of regions follow the photograph."""

    radius: int = parameter(6, "pixel", ge=0, le=100,
                            description="how far from the drawn border the true one may lie; 0 keeps it as drawn")


class DepthSection(Model):
    """The photograph's depth, for scenes in the open air."""

    regions: dict[Name, RegionDescription] = parameter(
        {}, description="later ones lie over earlier ones", max_length=500)
    labels: FileName | None = parameter(
        None, description="painted picture: #00ff00 is support, #ff0000 vertical, #0000ff sky (each connected patch"
                          " a region of its own), other colours as the regions' `label` says")
    map: DepthMap | None = parameter(None, description="for what no region covers")
    sky_depth: float = parameter(10000.0, "m", ge=1e-6, le=1e7, description="how far fog reaches before the open sky")
    refine: Refinement = Refinement()

    @model_validator(mode="after")
    def _something(self):
        if not self.regions and self.labels is None and self.map is None:
            raise mistake("nothing says how far anything is", "give 'regions', 'labels' or a 'map'")
        taken: dict[str, str] = {}
        for name, region in self.regions.items():
            if region.label is not None and self.labels is None:
                raise mistake(f"'{region.label}' is a colour of no picture", "give 'labels', the painted picture",
                              at=("regions", name, "label"))
            if region.label is not None and taken.setdefault(region.label.lower(), name) != name:
                raise mistake(f"'{region.label}' is the colour of {taken[region.label.lower()]}, too",
                              "paint each region in a colour of its own", at=("regions", name, "label"))
        return self

    def files(self) -> list[str]:
        return [file for file in (self.labels, self.map.file if self.map else None) if file]
