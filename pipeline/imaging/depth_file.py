"""Depth maps and painted label images from files, at the photograph's size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera

MAX_PIXELS = 100_000_000


def read_labels(path: Path, width: int, height: int, colours: list[str]) -> np.ndarray:
    """The painted picture (height, width, 3) uint8, each pixel the nearest of `colours` (#rrggbb).

    Painting programs smooth the borders of strokes; a pixel far from all colours is taken as the nearest too.
    Raises InputError where the file cannot be read or has another shape than the photograph.
    """
    pixels = np.round(255 * _read(path, 3)).astype(np.int16)
    if abs(pixels.shape[1] / pixels.shape[0] * height / width - 1) > 0.02:
        raise InputError(f"{pixels.shape[1]}x{pixels.shape[0]} pixels have another shape than the photograph's"
                         f" {width}x{height}", place=str(path), remedy="paint over the whole photograph")
    if pixels.shape[:2] != (height, width):
        pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_NEAREST)
    palette = np.array([[int(colour[i:i + 2], 16) for i in (1, 3, 5)] for colour in colours], np.int16)
    best, nearest = np.full((height, width), np.inf), np.zeros((height, width), int)
    for index, colour in enumerate(palette):
        off = ((pixels - colour).astype(np.int32) ** 2).sum(-1)
        nearest[off < best], best = index, np.minimum(best, off)
    return palette[nearest].astype(np.uint8)


def read_depth(path: Path, camera: Camera, *, kind: str, metres_per_unit: float | None = None,
               baseline: float | None = None, focal_length: float | None = None,
               principal_point: list[float] | None = None) -> np.ndarray:
    """Radial depth (height, width) [m] for the photograph's camera, NaN where the map knows none.

    kind: planar, radial or disparity (planar depth = focal_length * baseline / disparity). The map may have its
    own size, focal length and principal point [pixel]; it is looked up along the photograph's rays (for maps from
    the same place and direction). Zero, negative and non-finite values are unknown.
    """
    values, is_float = _read(path, 1)[..., 0].astype(float), _is_float(path)
    rows, columns = values.shape
    scale = columns / camera.width
    focal = focal_length or camera.focal_length * scale
    centre = np.asarray(principal_point if principal_point else camera.principal_point * scale, float)
    if focal_length is None and abs(rows / columns * camera.width / camera.height - 1) > 0.02:
        raise InputError(f"{columns}x{rows} values have another shape than the photograph's"
                         f" {camera.width}x{camera.height}", place=str(path),
                         remedy="give the map's own 'focal_length' and 'principal_point' [pixel]")
    if not is_float:
        values *= 65535 if _bits(path) > 8 else 255
    known = np.isfinite(values) & (values > 0)
    if not known.any():
        raise InputError("holds no depth above 0", place=str(path), remedy="check its unit and kind")
    with np.errstate(divide="ignore", invalid="ignore"):
        if kind == "disparity":
            planar = focal * baseline / np.where(known, values, np.nan)
        else:
            planar = np.where(known, values, np.nan) * (metres_per_unit or (1.0 if is_float else 1e-3))
    if kind == "radial":
        u, v = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        planar = planar / np.sqrt(1 + ((u - centre[0]) / focal) ** 2 + ((v - centre[1]) / focal) ** 2)
    tangents = (camera.pixel_centres() - camera.principal_point) / camera.focal_length
    at = tangents * focal + centre - 0.5
    sampled = _sampled(planar, at[..., 0], at[..., 1])
    return sampled * np.sqrt(1 + (tangents**2).sum(-1))


def _sampled(planar: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear where all four neighbours are alike, else the nearest: no depth between two things."""
    x, y = x.astype(np.float32), y.astype(np.float32)
    filled = planar.astype(np.float32)
    border = {"borderMode": cv2.BORDER_REPLICATE}
    nearest = cv2.remap(filled, x, y, cv2.INTER_NEAREST, **border)
    smooth = cv2.remap(filled, x, y, cv2.INTER_LINEAR, **border)
    alike = np.abs(smooth - nearest) < 0.02 * nearest
    outside = (x < -0.5) | (y < -0.5) | (x > planar.shape[1] - 0.5) | (y > planar.shape[0] - 0.5)
    return np.where(outside, np.nan, np.where(alike, smooth, nearest)).astype(float)


def _read(path: Path, channels: int) -> np.ndarray:
    """(H, W, channels) floats, integers scaled to 0..1."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        reason = " ".join(oiio.geterror().split()) or "unknown format"
        raise InputError(f"cannot be read as a picture ({reason})", place=str(path),
                         remedy="give a PNG, TIFF or EXR file")
    spec = source.spec()
    if spec.width * spec.height > MAX_PIXELS:
        raise InputError(f"has {spec.width}x{spec.height} pixels", place=str(path),
                         remedy=f"keep it below {MAX_PIXELS // 10**6} megapixels")
    values = source.read_image(0, 0, 0, min(spec.nchannels, channels), "float")
    if values is None:
        raise InputError(f"is damaged ({' '.join(source.geterror().split())})", place=str(path),
                         remedy="write it anew")
    values = np.asarray(values).reshape(spec.height, spec.width, -1)
    return np.repeat(values, channels, -1) if values.shape[2] < channels else values


def _is_float(path: Path) -> bool:
    return str(oiio.ImageInput.open(str(path)).spec().format) in ("half", "float", "double")


def _bits(path: Path) -> int:
    return 8 * oiio.ImageInput.open(str(path)).spec().format.basesize()
