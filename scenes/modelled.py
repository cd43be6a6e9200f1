"""What the scripts that render synthetic photographs share: their numbers, renders and files."""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

JPEG_QUALITY = 95


def numbers(file: Path) -> dict[str, float | np.ndarray]:
    """Numbers and vectors (3,) of an include of plain `#declare Name = value;` lines, by name."""
    found: dict[str, float | np.ndarray] = {}
    for name, value in re.findall(r"^#declare (\w+)\s*=\s*(.+?);", file.read_text(), re.M):
        parts = [float(part) for part in value.strip("<> ").split(",")]
        found[name] = np.array(parts) if value.startswith("<") else parts[0]
    return found


def rendered(model: Path, width: int, height: int, supersampling: int = 1, **declared: float) -> np.ndarray:
    """(height, width, 3) linear, by POV-Ray. One thread: its radiosity is not repeatable on several."""
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "image.exr"
        subprocess.run(["povray", f"+I{model.name}", f"+O{image}", "+FE", f"+W{supersampling * width}",
                        f"+H{supersampling * height}", "-A", "-D", "+WT1",
                        *(f"Declare={name}={value}" for name, value in declared.items())],
                       cwd=model.parent, check=True, capture_output=True, stdin=subprocess.DEVNULL)
        pixels = oiio.ImageBuf(str(image)).get_pixels("float")[..., :3]
    return pixels.reshape(height, supersampling, width, supersampling, 3).mean((1, 3))


def write_exr(path: Path, values: np.ndarray) -> None:
    """Half floats of (h, w) or (h, w, n); the same bytes each time."""
    values = np.atleast_3d(values)
    spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], "half")
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    output = oiio.ImageOutput.create(str(path))
    output.open(str(path), spec)
    output.write_image(np.ascontiguousarray(values, np.float32))
    output.close()


def write_photograph(folder: Path, linear: np.ndarray) -> None:
    """photograph.exr, and photograph.jpg as a camera would give it: 8-bit sRGB that clips at photo white."""
    write_exr(folder / "photograph.exr", linear)
    clipped = np.clip(linear, 0, 1)
    code = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    cv2.imwrite(str(folder / "photograph.jpg"), np.round(255 * code[..., ::-1]).astype(np.uint8),
                [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
