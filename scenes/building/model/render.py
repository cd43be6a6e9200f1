"""Re-render the synthetic photograph `building`, and state what is true about it.

    python scenes/building/model/render.py [--truth-only]

reads numbers.inc, renders building.pov, and writes beside the scene

- photograph.exr, photograph.jpg: linear, and as a camera would give it;
- true_depth.exr: metres along the ray through each pixel's centre, 0 for the sky;
- labels.png: each thing in its own colour, as a person would paint it: crowns filled, a pixel over the edge;
- truth.json: camera, sun, sky and points of the scene, units in the keys.

Nothing here repeats a number of the model.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import cv2
import numpy as np

MODEL = Path(__file__).resolve().parent
SCENE = MODEL.parent
sys.path[:0] = [str(SCENE.parents[1]), str(SCENE.parent)]  # so that the script runs from anywhere, uninstalled

import modelled  # noqa: E402
from pipeline.geometry.camera import Camera, from_field_of_view  # noqa: E402

WIDTH, HEIGHT = 560, 700
SUPERSAMPLING = 3  # per side; box-averaged in linear light
#: Colours of the painted labels by the model's numbers of things, far ones first; 0 is the sky.
COLOURS = {0: "#0000ff", 1: "#00ff00", 4: "#800000", 2: "#ff8000", 3: "#c00060", 6: "#408000", 5: "#204000",
           8: "#ff0000", 7: "#ff0000"}
TREES = (5, 6)


def camera(n: dict) -> Camera:
    return from_field_of_view(WIDTH, HEIGHT, n["Field_Of_View"], camera_height=n["Camera_Height"],
                              pitch=n["Camera_Pitch"])


def truth(n: dict) -> dict:
    """What is true of the photograph, units in the keys; pixels by the pipeline's camera."""
    view = camera(n)
    up, round_ = np.radians(n["Sun_Elevation"]), np.radians(n["Sun_Azimuth"])
    travel = -np.array([np.cos(up) * np.sin(round_), np.sin(up), -np.cos(up) * np.cos(round_)])

    def pixel(*points) -> list:
        return view.project(np.array(points, float))[0].round(2).tolist()

    def thrown(foot: np.ndarray, height: float) -> dict:
        """Foot, tip and shadow of an upright post."""
        tip = foot + [0, height, 0]
        foot_, tip_, shadow = pixel(foot, tip, tip - travel * (tip[1] / travel[1]))
        return {"foot": foot_, "tip": tip_, "shadow": shadow}

    def along_street(wall: str) -> list:
        return pixel([n[f"{wall}_Wall"], 0, -n[f"{wall}_From"]], [n[f"{wall}_Wall"], 0, -n[f"{wall}_To"]])

    return {
        "about": "True values of photograph.exr, by model/render.py from model/numbers.inc; no estimate may read them.",
        "camera": {"height_m": n["Camera_Height"], "pitch_degree": n["Camera_Pitch"],
                   "horizontal_field_of_view_degree": n["Field_Of_View"], "size_pixel": [WIDTH, HEIGHT]},
        "sun": {"direction": travel.round(6).tolist(), "elevation_degree": n["Sun_Elevation"],
                "irradiance_photo_unit_sr": n["Sun_Irradiance"].tolist()},
        "sky": {"radiance_photo_unit": n["Sky_Radiance"].tolist()},
        "albedo": {key: n[f"{key}_Albedo"].tolist() for key in ("Asphalt", "Paving", "Lawn", "Left", "Right", "End")},
        "shadows_pixel": {"tall_post": thrown(n["Tall_Post"], n["Tall_Post_Height"]),
                          "bollard": thrown(n["Bollard"], n["Bollard_Height"])},
        "feet_pixel": {"left_house": along_street("Left"), "right_house": along_street("Right"),
                       "end_house": pixel([n["End_Left"], 0, -n["End_From"]], [n["End_Right"], 0, -n["End_From"]]),
                       "tree": pixel(n["Tree"]), "far_tree": pixel(n["Far_Tree"])}}


def painted(things: np.ndarray) -> np.ndarray:
    """Label image (HEIGHT, WIDTH, 3) BGR of the things (HEIGHT, WIDTH), as by a person with a brush."""
    picture = np.zeros((*things.shape, 3), np.uint8)
    for thing, colour in COLOURS.items():
        mask = (things == thing).astype(np.uint8)
        if thing in TREES:
            mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (11, 11)))
        if thing > 1:
            mask = cv2.dilate(mask, np.ones((3, 3), np.uint8))
        picture[mask > 0] = [int(colour[i:i + 2], 16) for i in (5, 3, 1)]
    return picture


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth-only", action="store_true", help="write truth.json without rendering")
    options = parser.parse_args()
    n = modelled.numbers(MODEL / "numbers.inc")
    if not options.truth_only:
        model = MODEL / "building.pov"
        inverse = modelled.rendered(model, WIDTH, HEIGHT, Layer=1)[..., 0]
        depth = np.where(inverse > 0, 1 / np.maximum(inverse, 1e-6), 0)
        modelled.write_exr(SCENE / "true_depth.exr", depth)
        things = np.round(modelled.rendered(model, WIDTH, HEIGHT, Layer=2)[..., 0]).astype(int)
        cv2.imwrite(str(SCENE / "labels.png"), painted(things))
        modelled.write_photograph(SCENE, modelled.rendered(model, WIDTH, HEIGHT, SUPERSAMPLING))
    (SCENE / "truth.json").write_text(json.dumps(truth(n), indent=1) + "\n")


if __name__ == "__main__":
    main()
