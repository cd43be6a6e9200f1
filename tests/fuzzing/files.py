"""Mutations of the files that a scene names: photographs, label images, depth maps, density grids."""

from __future__ import annotations

import io
import os
import pickle
import struct
import zlib
from pathlib import Path
from random import Random

import imagecodecs
import numpy as np
import OpenImageIO as oiio

from tests.fuzzing.bases import Base

PICTURES = ("png", "jpg", "tif", "exr", "hdr")


def picture(rng: Random, path: Path, pixels: np.ndarray) -> None:
    """Another kind of file with the same pixels, or with strange ones: alpha, grey, NaN, another size."""
    suffix = path.suffix[1:]
    floats = suffix in ("exr", "hdr") or suffix == "tif" and rng.random() < 0.5
    height, width = pixels.shape[:2]
    way = rng.randrange(12)
    if way == 0:
        pixels = pixels[:, :, :1]
    elif way == 1 and suffix not in ("jpg", "hdr"):
        pixels = np.dstack([pixels, rng.choice([0, 128, 255]) * np.ones((height, width, 1), pixels.dtype)])
    elif way == 2:
        pixels = np.ascontiguousarray(pixels[:rng.choice([1, 2, height]), :rng.choice([1, 3, width // 2])])
    elif way == 3:
        pixels = np.repeat(np.repeat(pixels, rng.choice([1, 2]), 0), rng.choice([1, 2, 40]), 1)
    elif way == 4:
        pixels = np.full_like(pixels, rng.choice([0, 1, 255]))
    elif way == 5:
        pixels = np.random.default_rng(rng.randrange(2**32)).integers(0, 256, pixels.shape).astype(np.uint8)
    elif way == 6 and suffix in ("png", "tif"):
        pixels = pixels.astype(np.uint16) * 257
    elif way == 7 and suffix in ("tif", "exr"):
        pixels = np.repeat(pixels[:, :, :1], rng.choice([2, 5, 30]), 2)
    values = pixels
    if floats:
        values = pixels.astype(np.float32) / 255
        if rng.random() < 0.6:
            for _ in range(rng.choice([1, 10, 4000])):
                values[rng.randrange(values.shape[0]), rng.randrange(values.shape[1])] = rng.choice(
                    [np.nan, np.inf, -np.inf, -1.0, 1e38, 1e-40, 65504.0, -1e30])
    kinds = {"uint8": oiio.UINT8, "uint16": oiio.UINT16, "float32": rng.choice([oiio.FLOAT, oiio.HALF])}
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kinds[values.dtype.name])
    if rng.random() < 0.3:
        spec.attribute("Orientation", rng.randrange(0, 12))
    if rng.random() < 0.2:
        spec.attribute("Exif:FocalLengthIn35mmFilm", rng.choice([0, 1, 24, 65535]))
        spec.attribute("Exif:FocalLength", float(rng.choice([0.0, -1.0, 1e-30, 1e30])))
        spec.attribute("Exif:FocalPlaneXResolution", float(rng.choice([0.0, 1e-30, 1e30])))
    if suffix == "exr" and rng.random() < 0.4:
        spec.full_x, spec.full_y = rng.choice([0, -5, 30]), rng.choice([0, 7, 500])
        spec.full_width, spec.full_height = rng.choice([width, 1, 2 * width, 9000]), rng.choice([height, 3, 5000])
    if suffix == "exr" and rng.random() < 0.3:
        spec.attribute("chromaticities", "float[8]", rng.choice(
            [(0.0,) * 8, (0.3,) * 8, (float("nan"),) * 8, (0.7, 0.3, 0.2, 0.7, 0.1, 0.05, 0.3, 0.3)]))
    if rng.random() < 0.2:
        spec.attribute("ICCProfile", f"uint8[{200}]", bytes(rng.randrange(256) for _ in range(200)))
    out = oiio.ImageOutput.create(str(path))
    if out and out.open(str(path), spec):
        out.write_image(np.ascontiguousarray(values))
        out.close()
    if not path.exists():
        path.write_bytes(b"")


def png_with_header(rng: Random) -> bytes:
    """A few bytes that claim to be a huge picture, or an impossible one."""
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    sizes = [1, 8, 9_000, 60_000, 200_000, 2**31 - 1]
    header = struct.pack(">IIBBBBB", rng.choice(sizes), rng.choice(sizes), rng.choice([1, 2, 4, 8, 16]),
                         rng.choice([0, 2, 3, 4, 6]), 0, 0, rng.choice([0, 1]))
    palette = chunk(b"PLTE", bytes(rng.randrange(256) for _ in range(3 * rng.choice([1, 4, 256]))))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + palette
            + chunk(b"IDAT", zlib.compress(bytes(rng.choice([0, 10, 100_000])))) + chunk(b"IEND", b""))


def spoiled(rng: Random, data: bytes) -> bytes:
    """Cut off, with flipped bytes (most of them in the header), or with pieces repeated or zeroed."""
    data, way = bytearray(data), rng.randrange(6)
    if way == 0:
        return bytes(data[:rng.randrange(len(data) + 1)])
    if way == 1 and data:
        at = rng.randrange(len(data))
        size = rng.randrange(1, 200)
        data[at:at + size] = bytes(size) if rng.random() < 0.5 else bytes(data[:size])
        return bytes(data)
    if way == 2:
        return bytes(data) + bytes(rng.randrange(256) for _ in range(100))
    for _ in range(rng.choice([1, 2, 8, 60])):
        if data:
            reach = min(len(data), rng.choice([32, 128, 600, len(data)]))
            data[rng.randrange(reach)] = rng.choice([0, 255, 127, 128, rng.randrange(256)])
    return bytes(data)


def grid(rng: Random, suffix: str, files: dict[str, bytes]) -> bytes:
    """A density file that is none, or holds what no density is."""
    if suffix == "npy":
        shape = rng.choice([(3, 4, 5), (1, 1, 1), (0, 3, 3), (4, 4), (2, 2, 2, 2), (1, 70000, 1), (2, 2, 300)])
        dtype = rng.choice(["f4", "f8", "f2", "u1", "i8", "?", "c8", "S3", "M8[s]", "O", "u8", ">f4"])
        values = np.full(shape, Owned(), object) if dtype == "O" else np.arange(np.prod(shape)).reshape(shape).astype(dtype)
        if dtype in ("f4", "f8") and values.size:
            values.flat[0] = rng.choice([np.nan, np.inf, -1.0, 1e308, 1e-320, 0.0])
        if dtype in ("f4", "f8", "u1") and rng.random() < 0.3:
            values[...] = rng.choice([0, 1e-45, 1e38]) if dtype != "u1" else 0
        stream = io.BytesIO()
        np.lib.format.write_array(stream, np.asfortranarray(values) if rng.random() < 0.3 else values, allow_pickle=True)
        data = stream.getvalue()
        if rng.random() < 0.3:
            header = rng.choice([b"(99999, 99999, 999)", b"(-3, 4, 5)", b"(3, 4, 5e9)", b"()", b"((3,),)", b"'x'*10**9"])
            data = data.replace(repr(shape).encode(), header)
        if rng.random() < 0.1:
            data = pickle.dumps(Owned())
        if rng.random() < 0.1:
            stream = io.BytesIO()
            np.savez(stream, values=np.ones((2, 2, 2)))
            data = stream.getvalue()
    elif suffix == "df3":
        sizes = [rng.choice([0, 1, 2, 5, 40, 65535]) for _ in range(3)]
        data = np.array(sizes, ">u2").tobytes() + bytes(min(int(np.prod(sizes)), 10**5) * rng.choice([1, 2, 4]))
    else:
        data = files["density.vdb"]
    return spoiled(rng, data) if rng.random() < 0.6 else data


class Owned:
    """Whoever unpickles it leaves a file behind."""

    def __reduce__(self):
        return os.system, ("touch OWNED",)


def write(rng: Random, kind: str, base: Base, folder: Path) -> dict[str, str]:
    """Puts a mutated file of this kind into the scene's folder; what the scene must say to use it."""
    pixels = imagecodecs.png_decode(base.files["labels.png" if kind == "labels" and "labels.png" in base.files
                                               else "photograph.png"])[..., :3]
    if kind == "grid":
        suffix = rng.choice(["npy", "npy", "df3", "vdb", "vdb"])
        (folder / f"hostile.{suffix}").write_bytes(grid(rng, suffix, base.files))
        return {"fog": '{type: grid, file: "hostile.%s", visibility: 20, lower: [-5, 0, -20], upper: [5, 4, 0], '
                       'axes: %s, normalise: %s}' % (suffix, rng.choice(["xyz", "zyx"]), rng.choice(["mean", "max", "none"]))}
    suffix = rng.choice(PICTURES)
    path = folder / f"hostile.{suffix}"
    if rng.random() < 0.15:
        path.write_bytes(png_with_header(rng))
    elif kind == "depth" and rng.random() < 0.3:
        path.write_bytes(base.files["depth.png"])
    else:
        picture(rng, path, pixels)
    if rng.random() < 0.6:
        path.write_bytes(spoiled(rng, path.read_bytes()))
    if rng.random() < 0.1:
        path = path.rename(folder / f"hostile.{rng.choice([*PICTURES, 'npy', 'gif', 'svg', 'txt', 'mp4', 'PNG'])}")
    if kind == "photograph":
        return {"photograph.file": path.name, "photograph.colour_space": rng.choice(["auto"] * 4 + [
            "srgb", "linear", "display_p3", "adobe_rgb"])}
    if kind == "labels":
        return {"depth": '{labels: "%s"}' % path.name if rng.random() < 0.5 or "labels.png" not in base.files
                else '{labels: "%s", regions: {tree: {class: vertical, label: "#204000", porous: true}}}' % path.name}
    ways = ["kind: planar", "kind: radial", "kind: planar, metres_per_unit: 0.01", "kind: disparity, baseline: 0.2",
            "kind: planar, focal_length: 50", "kind: radial, metres_per_unit: 1.0e+6"]
    return {"depth": '{map: {file: "%s", %s}}' % (path.name, rng.choice(ways))}
