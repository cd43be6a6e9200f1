"""Re-render the synthetic photograph `lamps` and state what is true about it.

    python scenes/lamps/model/render.py [--truth-only]

reads numbers.inc, renders lamps.pov, and writes beside the scene photograph.exr (linear, scene-referred
Rec.709, 1 = photo white), photograph.jpg (8-bit sRGB as a camera would give it; lamps are burnt out) and
truth.json (camera and lights, units in the keys). Nothing here repeats a number of the model.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

MODEL = Path(__file__).resolve().parent
SCENE = MODEL.parent
sys.path[:0] = [str(SCENE.parents[1]), str(SCENE.parent)]  # so that the script runs from anywhere, uninstalled

import modelled  # noqa: E402
from pipeline.geometry.camera import Camera, from_field_of_view  # noqa: E402

WIDTH, HEIGHT = 768, 512
SUPERSAMPLING = 3  # per side; box-averaged in linear light


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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth-only", action="store_true", help="write truth.json without rendering")
    options = parser.parse_args()
    if not options.truth_only:
        modelled.write_photograph(SCENE, modelled.rendered(MODEL / "lamps.pov", WIDTH, HEIGHT, SUPERSAMPLING))
    known = truth(modelled.numbers(MODEL / "numbers.inc"))
    (SCENE / "truth.json").write_text(json.dumps(known, indent=1, default=np.ndarray.tolist) + "\n")


if __name__ == "__main__":
    main()
