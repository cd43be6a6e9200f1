"""The shipped scenes, made small: what the cases are mutated from."""

from __future__ import annotations

import io
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
from ruamel.yaml import YAML

SCENES = Path(__file__).resolve().parents[2] / "scenes"
#: Width [pixel] of the small pictures.
WIDTH = 64
CORNERS = 8
#: Of photographs that are fetched and may not be there.
SIZES = {"pagoda": (640, 427), "street": (768, 512), "bridge": (1302, 953)}
#: Keys below which lists of two numbers are pixels, and keys that hold lengths in pixels.
PIXELS = {"lines", "horizon", "pixels", "pixel", "holes", "foot", "tip", "shadow", "above", "corners", "edges"}
FOGS = {
    "grid": {"type": "grid", "file": "density.npy", "visibility": 20, "lower": [-5, 0, -20], "upper": [5, 4, 0]},
    "grid_df3": {"type": "grid", "file": "density.df3", "visibility": 20, "centre": [0, 2, -10], "size": [10, 4, 20]},
    "grid_vdb": {"type": "grid", "file": "density.vdb", "visibility": 20, "centre": [0, 2, -10], "size": [10, 4, 20]},
    "noise": {"type": "noise", "visibility": 20, "scale": 8, "detail": 1, "scale_height": 3},
    "layers": {"type": "layers", "visibility": 20, "layers": [{"lower": 0, "upper": 2}, {"lower": 3, "upper": 4}]},
    "height": {"type": "height", "visibility": 20, "scale_height": 2, "top_height": 5},
}
#: By the quantity that they are stated in; estimates by POV-Ray would cost seconds a case.
STRENGTHS = {"radiance": {"area", "ambient", "ground", "sky"}, "intensity": {"point", "spot", "lamps"},
             "irradiance": {"sun", "sunlight"}}


@dataclass(frozen=True)
class Base:
    """A small scene: its values, and the files in its folder by name."""

    name: str
    values: dict[str, Any]
    files: dict[str, bytes]

    @property
    def text(self) -> str:
        return dump(self.values)


def dump(values: Any) -> str:
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style, yaml.width = None, 110
    yaml.representer.ignore_aliases = lambda data: True
    stream = io.StringIO()
    yaml.dump(values, stream)
    return stream.getvalue()


@cache
def bases() -> tuple[Base, ...]:
    return tuple(_small(path) for path in sorted(SCENES.glob("*/scene.yaml")))


def _small(path: Path) -> Base:
    name, values = path.parent.name, YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    picture = next(iter(sorted(path.parent.glob("photograph.jpg"))), None)
    if picture:
        photograph = imagecodecs.jpeg_decode(picture.read_bytes())
        size = photograph.shape[1::-1]
    elif name in SIZES:
        size = SIZES[name]
    else:
        view = {"width": 256, "height": 256} if not (path.parent / "photograph.yaml").exists() else YAML(typ="safe").load((path.parent / "photograph.yaml").read_text(encoding="utf-8"))["view"]
        size = view["width"], view["height"]
    factor, height = WIDTH / size[0], round(WIDTH * size[1] / size[0])
    if not picture:
        v, u = np.mgrid[0:height, 0:WIDTH]
        photograph = np.stack([250 - 2 * v, 230 - v, 60 + 2 * u], -1).astype(np.uint8)
    files = {"photograph.png": imagecodecs.png_encode(_reduced(photograph, WIDTH, height)),
             "density.npy": _npy(np.random.default_rng(0).random((5, 4, 6)).astype(np.float32)),
             "density.df3": _df3(np.random.default_rng(1).integers(0, 255, (4, 5, 6), np.uint8)),
             "density.vdb": (SCENES.parent / "tests/reference/density.vdb").read_bytes(),
             "depth.png": imagecodecs.png_encode(np.linspace(2000, 30000, WIDTH * height)[::-1]
                                                .reshape(height, WIDTH).astype(np.uint16))}
    values = _scaled(values, factor, False)
    values["photograph"]["file"] = "photograph.png"
    if labels := values.get("depth", {}).get("labels"):
        files["labels.png"] = imagecodecs.png_encode(_reduced(
            imagecodecs.png_decode((path.parent / labels).read_bytes()), WIDTH, height))
        values["depth"]["labels"] = "labels.png"
    values.setdefault("fogs", {}).update(FOGS)
    values["render"] = {"samples": 4, "in_scattering_size": 32, **values.get("render", {})}
    if values.get("illumination", {}).get("type", "karsch") == "karsch":
        values["illumination"] = {"type": "manual"}
        for light in values["lights"].values():
            quantity = next(q for q, types in STRENGTHS.items() if light["type"] in types)
            light.setdefault(quantity, [1.0, 0.9, 0.8])
    return Base(name, values, files)


def _scaled(node: Any, factor: float, pixels: bool) -> Any:
    if isinstance(node, dict):
        return {key: round(value * factor, 2) if key == "radius" and "pixel" in node else
                _scaled(value, factor, pixels or key in PIXELS) for key, value in node.items()}
    if isinstance(node, list):
        # an outline of a few corners is as good a start, and its file is read in a third of the time
        kept = node[::-(-len(node) // CORNERS)] if pixels and len(node) > CORNERS else node
        return [_scaled(value, factor, pixels) for value in kept]
    return round(node * factor, 3) if pixels and isinstance(node, (int, float)) and not isinstance(node, bool) else node


def _reduced(picture: np.ndarray, width: int, height: int) -> np.ndarray:
    rows, columns = (np.arange(n) * picture.shape[k] // n for k, n in ((0, height), (1, width)))
    return np.ascontiguousarray(picture[rows][:, columns])


def _npy(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def _df3(values: np.ndarray) -> bytes:
    return np.array(values.shape[::-1], ">u2").tobytes() + values.tobytes()
