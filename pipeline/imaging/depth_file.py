"""Depth maps and painted label images from files, at the photograph's size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.geometry.camera import Camera
from pipeline.geometry.regions import nearest_index, torn
from pipeline.imaging.display_window import in_display_window
from pipeline.imaging.oiio_error import oiio_error

MAX_PIXELS = 100_000_000
MAX_CHANNELS = 64
#: By so much a file's shape may differ from the photograph's.
SAME_SHAPE = 0.02
#: Distance of a painted colour, in 8-bit values, at which it is the one of the palette beyond doubt, ...
SURE = 24
#: ... and at which it may still be that, painted by a less exact hand. Beyond, it is none.
ALIKE = 128
#: Of a pixel's eight neighbours, those that must be of its colour for it to be plainly painted.
FEWEST_ALIKE = 2
#: Width [pixel] of the border that painting programs smooth.
SMOOTHED = 3
#: Pixels at once.
_BLOCK = 1_000_000


def read_labels(path: Path, width: int, height: int, colours: list[str]) -> np.ndarray:
    """Which of `colours` (#rrggbb) each pixel is painted in, (height, width) int16; -1 where it is none of them.

    Painting programs smooth the borders of strokes: there the nearest plainly painted pixel counts, not the nearest
    colour, since between two colours may lie a third. Transparent pixels are not painted.
    Raises InputError where the file cannot be read or has another shape than the photograph.
    """
    pixels, opacity, _ = _read(path)
    _refuse_other_shape(pixels, "pixels", width, height, path, "paint over the whole photograph")
    if pixels.dtype != np.uint8:
        white = 1 if pixels.dtype.kind == "f" else np.iinfo(pixels.dtype).max
        # a damaged file may hold floats that are none
        with np.errstate(invalid="ignore", over="ignore"):
            pixels = np.round(np.clip(np.nan_to_num(pixels / np.float32(white)), 0, 1) * 255).astype(np.uint8)
    red, green, blue = (pixels[..., k].astype(np.uint32) for k in ((0, 1, 2) if pixels.shape[2] >= 3 else (0, 0, 0)))
    packed = (red << 16) + (green << 8) + blue
    # a painted picture has few colours, so that each is looked up once
    present = np.zeros(1 << 24, bool)
    present[packed] = True
    codes = np.flatnonzero(present)
    rgb = np.stack([codes >> 16, codes >> 8 & 255, codes & 255], -1).astype(float)
    palette = np.array([[int(colour[i:i + 2], 16) for i in (1, 3, 5)] for colour in colours], float)
    off, label = np.full(len(codes), np.inf), np.full(len(codes), -1, np.int16)
    for index, colour in enumerate(palette):
        distance = np.linalg.norm(rgb - colour, axis=1)
        label[distance < off], off = index, np.minimum(off, distance)
    table = np.full((2, 1 << 24), -1, np.int16)
    table[0, codes], table[1, codes] = np.where(off <= ALIKE, label, -1), np.where(off <= SURE, label, -1)
    labels, sure = table[0][packed], table[1][packed]
    if opacity is not None:
        labels[opacity < 0.5], sure[opacity < 0.5] = -1, -1
    # a plain pixel has some like it beside it; single ones of a third colour lie on a border that goes through it
    sure = np.where(_like_neighbours(sure) >= FEWEST_ALIKE, sure, -1)
    if (sure >= 0).any() and (sure < 0).any():
        unsure = sure < 0
        near = unsure & (cv2.distanceTransform(unsure.astype(np.uint8), cv2.DIST_L2, 5) <= SMOOTHED)
        labels[near] = labels.ravel()[nearest_index(~unsure)[near]]
    if labels.shape != (height, width):
        labels = cv2.resize(labels, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    return labels


def _like_neighbours(labels: np.ndarray) -> np.ndarray:
    """How many of its eight neighbours (H, W) are as a pixel is."""
    padded = np.pad(labels, 1, constant_values=-2)
    height, width = labels.shape
    count = np.zeros(labels.shape, np.uint8)
    for top, left in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
        count += padded[top:top + height, left:left + width] == labels
    return count


def read_depth(path: Path, camera: Camera, *, kind: str, metres_per_unit: float | None = None,
               baseline: float | None = None, focal_length: float | None = None,
               principal_point: list[float] | None = None) -> np.ndarray:
    """Radial depth (height, width) [m] for the photograph's camera, NaN where the map knows none.

    kind: planar, radial or disparity (planar depth = focal_length * baseline / disparity). The map may have its
    own size, focal length and principal point [pixel]; it is looked up along the photograph's rays (for maps from
    the same place and direction). Zero, negative and non-finite values are unknown.
    """
    values, opacity, names = _read(path)
    values, exact = _one_channel(values, names, path), values.dtype.kind != "f"
    rows, columns = values.shape
    if focal_length is None:
        _refuse_other_shape(values, "values", camera.width, camera.height, path,
                            "give the map's own 'focal_length' and 'principal_point' [pixel]")
    if values.dtype == np.uint8 and kind != "disparity" and metres_per_unit is None:
        raise InputError("has 8 bits a value, which in millimetres reach no farther than 0.255 m", place=str(path),
                         remedy="give 'metres_per_unit' [m]")
    known = np.isfinite(values) & (values > 0)
    if opacity is not None:
        known &= opacity > 0
    if not known.any():
        raise InputError("holds no depth above 0", place=str(path), remedy="check its unit and kind")
    scale = np.array([columns / camera.width, rows / camera.height])
    focal = np.full(2, focal_length) if focal_length else camera.focal_length * scale
    if principal_point:
        centre = np.asarray(principal_point, float)
    elif focal_length:  # another lens: off its own centre by the same angle
        off = camera.principal_point - [camera.width / 2, camera.height / 2]
        centre = np.array([columns, rows]) / 2 + off * focal / camera.focal_length
    else:
        centre = camera.principal_point * scale
    # what is linear along planes, and so between pixels, is the inverse of planar depth
    inverse = np.where(known, values, np.nan).astype(float)
    if kind == "disparity":
        inverse /= focal[0] * baseline
    else:
        inverse = 1 / (inverse * (metres_per_unit or (1e-3 if exact else 1.0)))
    if kind == "radial":
        inverse *= np.sqrt(1 + ((np.arange(columns) + 0.5 - centre[0]) / focal[0]) ** 2
                           + ((np.arange(rows)[:, None] + 0.5 - centre[1]) / focal[1]) ** 2)
    tears = [np.pad(torn(1 / inverse, axis), ((0, 1 - axis), (0, axis))) for axis in (0, 1)]
    depth = np.empty((camera.height, camera.width))
    x = (np.arange(camera.width) + 0.5 - camera.principal_point[0]) / camera.focal_length
    step = max(1, _BLOCK // camera.width)
    for top in range(0, camera.height, step):
        y = (np.arange(top, min(top + step, camera.height)) + 0.5 - camera.principal_point[1]) / camera.focal_length
        sampled = _sampled(inverse, tears, x * focal[0] + centre[0] - 0.5, y * focal[1] + centre[1] - 0.5)
        depth[top:top + step] = np.sqrt(1 + x**2 + y[:, None] ** 2) / sampled
    return depth


def _sampled(inverse: np.ndarray, tears: list[np.ndarray], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Inverse depth at columns x (w,) and rows y (h,), (h, w); NaN outside.

    Bilinear where there is no tear between the four neighbours, else the nearest: no depth between two things.
    tears: (H, W) each, between a pixel and the next below it or to its right.
    """
    def ends(at, size):
        at = np.where((at < -0.5 - 1e-9) | (at > size - 0.5 + 1e-9), np.nan, at)
        low = np.clip(np.floor(np.nan_to_num(at)), 0, max(size - 2, 0)).astype(int)
        return low, np.minimum(low + 1, size - 1), at - low

    (top, bottom, down), (left, right, across) = ends(y, inverse.shape[0]), ends(x, inverse.shape[1])
    four = [inverse[rows][:, columns] for rows in (top, bottom) for columns in (left, right)]
    whole = ~(tears[0][top][:, left] | tears[0][top][:, right] | tears[1][top][:, left] | tears[1][bottom][:, left])
    down = down[:, None]
    above, below = (1 - across) * four[0] + across * four[1], (1 - across) * four[2] + across * four[3]
    smooth = (1 - down) * above + down * below
    nearest = np.where(down > 0.5, np.where(across > 0.5, four[3], four[2]), np.where(across > 0.5, four[1], four[0]))
    with np.errstate(invalid="ignore"):
        return np.where(whole & (smooth > 0) | np.isnan(down + across), smooth, nearest)


def _refuse_other_shape(values: np.ndarray, what: str, width: int, height: int, path: Path, remedy: str) -> None:
    rows, columns = values.shape[:2]
    # an outline of few pixels is rounded to whole ones
    off = abs(columns * height - rows * width)
    if off > SAME_SHAPE * columns * height and off > max(height, width) / 2:
        raise InputError(f"{columns}x{rows} {what} have another shape than the photograph's {width}x{height}",
                         place=str(path), remedy=remedy)


def _one_channel(values: np.ndarray, names: list[str], path: Path) -> np.ndarray:
    """The channel (H, W) that holds depth: the only one, the one called so, or the same three times."""
    leaves = [name.rpartition(".")[2].lower() for name in names]
    for name in ("z", "depth", "disparity", "v", "y"):
        if name in leaves:
            return values[..., leaves.index(name)]
    if (values == values[..., :1]).all() or (np.isnan(values) == np.isnan(values[..., :1])).all() and (
            np.nan_to_num(values) == np.nan_to_num(values[..., :1])).all():
        return values[..., 0]
    raise InputError(f"has the channels {', '.join(names)}, which differ", place=str(path),
                     remedy="give a file of one channel, not a picture of depth in colours")


def _read(path: Path) -> tuple[np.ndarray, np.ndarray | None, list[str]]:
    """Values (H, W, n) as stored, opacity (H, W) from 0 to 1 if there is one, and the n channels' names."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # otherwise values come back multiplied by alpha
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        reason = oiio_error(oiio) or "unknown format"
        raise InputError(f"cannot be read as a picture ({reason})", place=str(path),
                         remedy="give a PNG, TIFF or EXR file")
    spec = source.spec()
    if max(spec.width * spec.height, spec.full_width * spec.full_height) > MAX_PIXELS:
        raise InputError(f"has {spec.width}x{spec.height} pixels", place=str(path),
                         remedy=f"keep it below {MAX_PIXELS // 10**6} megapixels, which is fixed; it may be smaller than the"
                                " photograph")
    if spec.nchannels > MAX_CHANNELS:
        raise InputError(f"has {spec.nchannels} channels", place=str(path),
                         remedy=f"save it with {MAX_CHANNELS} at most, which is fixed")
    values = source.read_image(0, 0, 0, spec.nchannels, spec.format)
    if values is None or source.has_error:
        raise InputError(f"is damaged ({oiio_error(source)})", place=str(path),
                         remedy="write it anew")
    values = np.asarray(values).reshape(spec.height, spec.width, spec.nchannels)
    if values.dtype.kind == "f":
        values = in_display_window(values, spec, missing=np.nan)
    names = list(spec.channelnames)
    opacity = None
    if 0 <= spec.alpha_channel < spec.nchannels and spec.nchannels > 1:
        opacity = values[..., spec.alpha_channel].astype(np.float32)
        if values.dtype.kind == "u":
            opacity /= np.iinfo(values.dtype).max
        values = np.delete(values, spec.alpha_channel, axis=2)
        del names[spec.alpha_channel]
    return values, opacity, names
