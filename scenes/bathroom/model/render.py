"""Re-render the synthetic photograph `bathroom` and state what is true about it.

    python scenes/bathroom/model/render.py [--truth-only]

reads numbers.inc, renders bathroom.pov, and writes beside the scene

- photograph.exr: linear, scene-referred Rec.709, photo unit (1 = photo white);
- photograph.jpg: the 8-bit sRGB picture that a camera would give; it clips at photo white;
- truth.json: lights, camera, geometry and reflectances, units in the keys;
- annotations.json: where the corners, edges, lights and the sun patch truly project to.

Nothing here repeats a number of the model: change numbers.inc and run again.
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

from pipeline.errors import InputError  # noqa: E402
from pipeline.geometry.camera import Camera, rotation  # noqa: E402

SUPERSAMPLING = 3  # per side; box-averaged in linear light, so that grout lines do not alias
JPEG_QUALITY = 95
GRANITE_MEAN = 0.376  # of POV-Ray's granite pattern over the platform's front, averaged from a render

AXES = {"x": 0, "y": 1, "z": 2}
EDGE_SAMPLES = 41  # points tested for visibility along each edge


# ---- The model's numbers --------------------------------------------------------------------------------

def read_numbers(path: Path = MODEL / "numbers.inc") -> dict[str, float | np.ndarray]:
    """Numbers and (3,) vectors of an include of plain `#declare Name = value;` lines, by name.

    Raises InputError for a `#declare` that is neither a number nor a vector of three numbers.
    """
    number = r"[-+]?\d*\.?\d+(?:[eE][-+]?\d+)?"
    vector = rf"<\s*({number})\s*,\s*({number})\s*,\s*({number})\s*>"
    found: dict[str, float | np.ndarray] = {}
    for line_number, line in enumerate(path.read_text().splitlines(), 1):
        code = line.split("//")[0].strip()
        if not code.startswith("#declare"):
            continue
        match = re.fullmatch(rf"#declare\s+(\w+)\s*=\s*(?:({number})|{vector})\s*;", code)
        if not match:
            raise InputError(f"cannot read '{code}'", remedy="write '#declare Name = 1.5;' or "
                             "'#declare Name = <1, 2, 3>;'", place=f"{path}:{line_number}")
        name, scalar, *components = match.groups()
        found[name] = float(scalar) if scalar else np.array(components, float)
    return found


def camera_of(n: dict) -> Camera:
    """The model's camera, in the convention of pipeline.geometry.camera."""
    size = int(n["Image_Size"])
    focal_length = 0.5 * size / np.tan(np.radians(n["Camera_Field"]) / 2)
    return Camera(size, size, focal_length, n["Principal_Point"][:2],
                  rotation(n["Camera_Yaw"], n["Camera_Pitch"]), n["Camera_Position"])


def rectangle(n: dict, name: str) -> np.ndarray:
    """Corners, (4, 3) [m], of a light: round the rectangle from its first corner, edge 1 first."""
    corner, edge_1, edge_2 = (n[f"{name}_{part}"] for part in ("Corner", "Edge_1", "Edge_2"))
    return corner + np.array([0 * edge_1, edge_1, edge_1 + edge_2, edge_2])


def sun_patch(n: dict) -> np.ndarray:
    """The window's corners carried along the sun to the floor, (4, 3) [m], in the window's order.

    The model keeps the sun's path free, so that this is the whole lit area (a test compares it with the
    photograph). Raises InputError if the patch leaves the free floor.
    """
    window, travel = rectangle(n, "Window"), n["Sun_Travel"]
    patch = window - window[:, 1:2] / travel[1] * travel
    low, high = patch.min(0), patch.max(0)
    if np.any(low[[0, 2]] < n["Room_Min"][[0, 2]]) or np.any(high[[0, 2]] > n["Room_Max"][[0, 2]]):
        raise InputError(f"the sun patch {patch.tolist()} leaves the floor",
                         remedy="change Sun_Travel or the window", place="numbers.inc")
    for name in ("Tub", "Platform"):
        box_low, box_high = n[f"{name}_Min"], n[f"{name}_Max"]
        if all(low[i] < box_high[i] and high[i] > box_low[i] for i in (0, 2)):
            raise InputError(f"the sun patch {patch.tolist()} may touch the {name.lower()}",
                             remedy="change Sun_Travel or the window", place="numbers.inc")
    return patch


def mean_tile_albedo(n: dict, tile: str, size: str, grout: str) -> np.ndarray:
    """Mean diffuse reflectance, (3,), of tiles whose colour is uniform between A and B, with their grout."""
    open_share = (1 - n["Grout_Width"] / n[f"{size}_Tile_Size"]) ** 2
    return open_share * (n[f"{tile}_A"] + n[f"{tile}_B"]) / 2 + (1 - open_share) * n[grout]


# ---- Truth ----------------------------------------------------------------------------------------------

def truth_of(n: dict) -> dict:
    """Everything that is known exactly about the photograph. Radiance in photograph.exr's unit."""
    camera, exposure = camera_of(n), n["Exposure"]

    def light(name: str, radiance: str) -> dict:
        corners = rectangle(n, name)
        edge_1, edge_2 = n[f"{name}_Edge_1"], n[f"{name}_Edge_2"]
        normal = np.cross(edge_1, edge_2)
        return {"corners_m": corners, "normal": normal / np.linalg.norm(normal),
                "area_m2": np.linalg.norm(normal), "radiance_photo_unit": exposure * n[radiance]}

    def box(name: str) -> dict:
        return {"min_m": n[f"{name}_Min"], "max_m": n[f"{name}_Max"]}

    kind = {"kind": "lambertian_rectangle"}
    return {
        "about": "True values of photograph.exr. Written by model/render.py from model/numbers.inc; "
                 "for tests and benchmarks only: no estimate may read them.",
        "world": "metres, right-handed, y up, floor y = 0; a camera of yaw 0 looks along -z",
        "exposure_photo_unit_per_model_unit": exposure,
        "photograph_jpg": "8-bit sRGB encoding of clip(photograph.exr, 0, 1)",
        "camera": {
            "width_px": camera.width, "height_px": camera.height,
            "focal_length_px": camera.focal_length, "principal_point_px": camera.principal_point,
            "horizontal_field_degree": n["Camera_Field"], "yaw_degree": n["Camera_Yaw"],
            "pitch_degree": n["Camera_Pitch"], "roll_degree": 0.0,
            "position_m": camera.position, "world_from_camera": camera.world_from_camera,
        },
        "lights": {
            "ceiling_lamp": kind | light("Ceiling_Lamp", "Ceiling_Lamp_Radiance"),
            "mirror_lamp": kind | light("Mirror_Lamp", "Mirror_Lamp_Radiance"),
            "sky": kind | light("Window", "Sky_Radiance"),
            "sun": {
                "kind": "directional",
                "direction_of_travel": n["Sun_Travel"] / np.linalg.norm(n["Sun_Travel"]),
                "irradiance_facing_sun_photo_unit_sr": exposure * n["Sun_Irradiance"],
                "irradiance_on_floor_photo_unit_sr": exposure * n["Sun_Irradiance"]
                * -n["Sun_Travel"][1] / np.linalg.norm(n["Sun_Travel"]),
                "patch_corners_m": sun_patch(n),
            },
        },
        "room": box("Room"),
        "boxes": {"tub": box("Tub"), "platform": box("Platform")},
        "unmodelled_boxes": {"mirror": box("Mirror"), "door": box("Door")},
        "window_corners_m": rectangle(n, "Window"),
        "albedo": {
            "wall": mean_tile_albedo(n, "Wall_Tile", "Wall", "Wall_Grout"),
            "wall_dark_course": mean_tile_albedo(n, "Band", "Wall", "Wall_Grout"),
            "floor": mean_tile_albedo(n, "Floor_Tile", "Floor", "Floor_Grout"),
            "ceiling": n["Ceiling_Paint"], "tub": n["Tub_White"],
            "platform": n["Platform_A"] + GRANITE_MEAN * (n["Platform_B"] - n["Platform_A"]),
            "mirror": n["Mirror_Panel"], "door": n["Door_Wood"], "white_trim": n["White_Trim"],
        },
    }


# ---- Annotations ----------------------------------------------------------------------------------------

BOX_CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def corner_name(which: np.ndarray) -> str:
    """`left_floor_back` and the like of a box corner, (3,) of 0 and 1."""
    sides = (("left", "right"), ("floor", "top"), ("back", "front"))
    return "_".join(names[int(i)] for names, i in zip(sides, which))


def annotations_of(n: dict) -> dict:
    """Exact pixels of what a person would click on, with the world points that they show."""
    camera = camera_of(n)
    room = np.array([n["Room_Min"], n["Room_Max"]])
    boxes = {name: np.array([n[f"{name.title()}_Min"], n[f"{name.title()}_Max"]])
             for name in ("tub", "platform")}
    solid = list(boxes.values()) + [np.array([n["Door_Min"], n["Door_Max"]])]

    def marked(points: np.ndarray) -> dict:
        points = np.asarray(points, float)
        return {"pixels": camera.project(points)[0], "world_m": points,
                "visible": visible(camera, points, solid)}

    def corners(box: np.ndarray) -> dict:
        return {corner_name(w): marked(np.where(w, box[1], box[0])) for w in BOX_CORNERS}

    edges = []
    for name, box in {"room": room, **boxes}.items():
        for axis, i in AXES.items():
            for start in BOX_CORNERS[BOX_CORNERS[:, i] == 0]:
                ends = np.where([start, start + np.eye(3, dtype=int)[i]], box[1], box[0])
                run = longest_visible(camera, np.linspace(*ends, EDGE_SAMPLES), solid)
                if run is not None:
                    edges.append({"of": name, "axis": axis, "pixels": camera.project(run)[0], "world_m": run})
    for name in ("Window", "Ceiling_Lamp", "Mirror_Lamp"):
        around = rectangle(n, name)
        for a, b in zip(around, np.roll(around, -1, 0)):
            axis = list(AXES)[int(np.argmax(np.abs(b - a)))]
            edges.append({"of": name.lower(), "axis": axis, "pixels": camera.project(np.array([a, b]))[0],
                          "world_m": np.array([a, b])})
    return {
        "about": "Exact projections of the model. Written by model/render.py. Pixels: u right, v down from "
                 "the top-left corner of photograph.jpg; the first pixel's centre is (0.5, 0.5). "
                 "`visible`: in the frame and hidden by no tub, platform or door; small things may cover it.",
        "image_size_px": [camera.width, camera.height],
        "room_corners": corners(room),
        "boxes": {name: corners(box) for name, box in boxes.items()},
        "ceiling_lamp": marked(rectangle(n, "Ceiling_Lamp")),
        "mirror_lamp": marked(rectangle(n, "Mirror_Lamp")),
        "window": marked(rectangle(n, "Window")),
        "sun_patch": marked(sun_patch(n)),
        "edges": edges,
    }


def visible(camera: Camera, points: np.ndarray, solid: list[np.ndarray]) -> np.ndarray:
    """Whether world `points`, (..., 3), lie within the frame and before all `solid` boxes, (2, 3) each."""
    pixels, planar_depth = camera.project(points)
    with np.errstate(invalid="ignore"):
        free = (planar_depth > 0) & np.all((pixels >= 0) & (pixels <= [camera.width, camera.height]), -1)
    # A point on a box is not hidden by it: stop the segment a millimetre short, as seen from the camera.
    away = points - camera.position
    distance = np.linalg.norm(away, axis=-1, keepdims=True)
    reach = away * (1 - 1e-3 / distance)
    for low, high in solid:
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - camera.position) / reach, (high - camera.position) / reach
        enter, leave = np.fmin(a, b).max(-1), np.fmax(a, b).min(-1)
        free &= ~((enter < leave - 1e-9) & (enter < 1) & (leave > 0))
    return free


def longest_visible(camera: Camera, points: np.ndarray, solid: list[np.ndarray]) -> np.ndarray | None:
    """First and last point, (2, 3), of the longest visible run among `points`, (n, 3); None if none is."""
    seen = np.concatenate([[0], visible(camera, points, solid), [0]]).astype(int)
    starts, stops = np.flatnonzero(np.diff(seen) == 1), np.flatnonzero(np.diff(seen) == -1)
    if not len(starts) or (stops - starts).max() < 3:
        return None
    best = int(np.argmax(stops - starts))
    return points[[starts[best], stops[best] - 1]]


# ---- Pictures -------------------------------------------------------------------------------------------

def srgb_encoded(linear: np.ndarray) -> np.ndarray:
    """sRGB code values in 0..1 of linear values, clipped at photo white (IEC 61966-2-1)."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def povray(size: int, output: Path, *options: str) -> None:
    """Render the model to a half-float EXR. Raises InputError with POV-Ray's own complaint.

    One thread: POV-Ray's radiosity depends on the order in which threads fill its cache.
    """
    command = ["povray", "bathroom.pov", f"+W{size}", f"+H{size}", "-D", "-GR", "-GS", "+FE", "+WT1",
               f"+O{output}", *options]
    try:
        done = subprocess.run(command, cwd=MODEL, capture_output=True, text=True)
    except FileNotFoundError:
        raise InputError("povray is not installed", remedy="install POV-Ray 3.7") from None
    if done.returncode or not output.exists():
        errors = [line for line in done.stderr.splitlines() if "rror" in line or line.startswith("File ")]
        raise InputError(f"POV-Ray failed: {' '.join(errors) or done.stderr[-400:]}",
                         remedy="mend the model", place=str(MODEL / "bathroom.pov"))


def read_exr(path: Path) -> np.ndarray:
    """(height, width, 3) float32, linear."""
    return np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT))[..., :3]


def rendered(size: int) -> np.ndarray:
    """The photograph, (size, size, 3) float32 [photo unit].

    Indirect light is smooth and found first, at low resolution and with few sub-lights; the second
    render reads it from POV-Ray's radiosity file and adds direct light with all sub-lights.
    """
    with tempfile.TemporaryDirectory() as folder:
        cache, image = Path(folder) / "indirect.rca", Path(folder) / "image.exr"
        povray(size // 2, image, "+RFO", f"+RF{cache}", "Declare=Sublights=2")
        povray(size * SUPERSAMPLING, image, "+RFI", f"+RF{cache}", "Declare=Reuse_Indirect=1")
        fine = read_exr(image)
    return fine.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).mean((1, 3))


def write_pictures(linear: np.ndarray) -> None:
    """photograph.exr and photograph.jpg from a linear picture, (height, width, 3) [photo unit]."""
    height, width = linear.shape[:2]
    spec = oiio.ImageSpec(width, height, 3, oiio.HALF)
    spec.attribute("compression", "zip")
    spec.attribute("oiio:ColorSpace", "lin_rec709")
    spec.attribute("ImageDescription", "Synthetic bathroom; linear Rec.709, photo unit: 1 = photo white")
    buffer = oiio.ImageBuf(oiio.ImageSpec(width, height, 3, oiio.FLOAT))
    buffer.set_pixels(oiio.ROI(), np.ascontiguousarray(linear, np.float32))
    buffer.copy_metadata(oiio.ImageBuf(spec))
    if not buffer.write(str(SCENE / "photograph.exr"), oiio.HALF):
        raise InputError(buffer.geterror(), remedy="make the folder writable", place=str(SCENE))
    codes = np.round(255 * srgb_encoded(read_exr(SCENE / "photograph.exr"))).astype(np.uint8)
    cv2.imwrite(str(SCENE / "photograph.jpg"), codes[..., ::-1],
                [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY,
                 cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444])


def write_json(path: Path, content: dict) -> None:
    """Indented JSON with short arrays on one line."""
    def plain(value):
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        if isinstance(value, np.ndarray):
            return plain(value.tolist())
        if isinstance(value, (list, tuple)):
            return [plain(item) for item in value]
        if isinstance(value, np.generic):
            return plain(value.item())
        if isinstance(value, float):
            return None if np.isnan(value) else round(value, 9)  # NaN: behind the camera
        return value
    text = json.dumps(plain(content), indent=1)
    text = re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: "[" + re.sub(r"\s*\n\s*", " ", m[1]) + "]", text)
    path.write_text(text + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--truth-only", action="store_true", help="rewrite the JSON files, keep the pictures")
    arguments = parser.parse_args()
    try:
        numbers = read_numbers()
        write_json(SCENE / "truth.json", truth_of(numbers))
        write_json(SCENE / "annotations.json", annotations_of(numbers))
        if not arguments.truth_only:
            write_pictures(rendered(int(numbers["Image_Size"])))
    except InputError as mistake:
        sys.exit(f"error: {mistake}")


if __name__ == "__main__":
    main()
