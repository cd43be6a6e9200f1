"""Re-render the synthetic photograph `lamps` and state what is true about it.

    python scenes/lamps/model/render.py [--truth-only]

reads numbers.inc, renders lamps.pov, and writes beside the scene photograph.exr (linear, scene-referred
Rec.709, 1 = photo white), photograph.jpg (8-bit sRGB as a camera would give it; lamps are burnt out) and
truth.json (camera and lights, units in the keys). Nothing here repeats a number of the model.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import OpenImageIO as oiio

MODEL = Path(__file__).resolve().parent
SCENE = MODEL.parent
sys.path.insert(0, str(SCENE.parents[1]))  # so that the script runs from anywhere, uninstalled

from pipeline.geometry.camera import Camera, from_field_of_view  # noqa: E402

WIDTH, HEIGHT = 768, 512
SUPERSAMPLING = 3  # per side; box-averaged in linear light
JPEG_QUALITY = 95


def numbers() -> dict[str, float | list[float]]:
    """Numbers and vectors of numbers.inc by name."""
    found: dict[str, float | list[float]] = {}
    for name, value in re.findall(r"^#declare (\w+)\s*=\s*(.+?);", (MODEL / "numbers.inc").read_text(), re.M):
        parts = [float(part) for part in value.strip("<> ").split(",")]
        found[name] = parts if value.startswith("<") else parts[0]
    return found


def camera(n: dict) -> Camera:
    return from_field_of_view(WIDTH, HEIGHT, n["Field_Of_View"], camera_height=n["Camera_Height"],
                              pitch=n["Camera_Pitch"])


def truth(n: dict) -> dict:
    """What is true of the photograph, units in the keys; pixels by the pipeline's camera."""
    lamps = [[side * n["Lamp_Side"], n["Lamp_Height"], -(n["Lamp_First"] + i * n["Lamp_Distance"])]
             for i in range(int(n["Lamp_Pairs"])) for side in (-1, 1)]
    beams = [[n["Car_X"] + side * n["Beam_Side"], n["Beam_Height"], n["Car_Front"]] for side in (-1, 1)]
    view = camera(n)
    return {
        "camera": {"height_m": n["Camera_Height"], "pitch_degree": n["Camera_Pitch"],
                   "horizontal_field_of_view_degree": n["Field_Of_View"], "size_pixel": [WIDTH, HEIGHT]},
        "lamps": {"position_m": lamps, "position_pixel": view.project(np.array(lamps))[0].round(2).tolist(),
                  "radius_m": n["Lamp_Radius"], "intensity_photo_unit_m2": n["Lamp_Intensity"]},
        "headlights": {"position_m": beams, "position_pixel": view.project(np.array(beams))[0].round(2).tolist(),
                       "target_m": n["Beam_Target"], "radius_m": n["Beam_Radius"],
                       "inner_angle_degree": n["Beam_Inner"], "outer_angle_degree": n["Beam_Outer"],
                       "intensity_photo_unit_m2": n["Beam_Intensity"]},
        "sky_radiance_photo_unit": n["Night_Sky"], "road_albedo": n["Road_Albedo"],
        "pavement_albedo": n["Pavement_Albedo"], "facade_side_m": n["Facade_Side"],
        "street_end_m": n["Street_End"]}


def render() -> np.ndarray:
    """(HEIGHT, WIDTH, 3) linear. One thread: POV-Ray's radiosity is not repeatable on several."""
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder) / "lamps.exr"
        subprocess.run(["povray", "+Ilamps.pov", f"+O{image}", "+FE", f"+W{SUPERSAMPLING * WIDTH}",
                        f"+H{SUPERSAMPLING * HEIGHT}", "-A", "-D", "+WT1"], cwd=MODEL, check=True,
                       capture_output=True, stdin=subprocess.DEVNULL)
        pixels = oiio.ImageBuf(str(image)).get_pixels("float")[..., :3]
    return pixels.reshape(HEIGHT, SUPERSAMPLING, WIDTH, SUPERSAMPLING, 3).mean((1, 3))


def write(photograph: np.ndarray) -> None:
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "half")
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    output = oiio.ImageOutput.create(str(SCENE / "photograph.exr"))
    output.open(str(SCENE / "photograph.exr"), spec)
    output.write_image(np.ascontiguousarray(photograph, np.float32))
    output.close()
    clipped = np.clip(photograph, 0, 1)
    code = np.where(clipped <= 0.0031308, 12.92 * clipped, 1.055 * clipped ** (1 / 2.4) - 0.055)
    cv2.imwrite(str(SCENE / "photograph.jpg"), np.round(255 * code[..., ::-1]).astype(np.uint8),
                [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth-only", action="store_true", help="write truth.json without rendering")
    options = parser.parse_args()
    if not options.truth_only:
        write(render())
    (SCENE / "truth.json").write_text(json.dumps(truth(numbers()), indent=1) + "\n")


if __name__ == "__main__":
    main()
