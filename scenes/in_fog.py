"""What the scripts that render a model in its scene's fogs share: the fogs, and the files.

A truth is `scenes/NAME/truth/FOG.exr`: linear, scene-referred, what the photograph's camera would have seen had the fog
been there. Its metadata say in which fog, so that a truth of another one is told.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.scene.load import load_scene


@dataclass(frozen=True)
class Fog:
    """An even fog of a scene: coefficients (3,) [1/m], asymmetry of its phase function (Henyey-Greenstein)."""

    name: str
    absorption: np.ndarray
    scattering: np.ndarray
    asymmetry: float

    @property
    def extinction(self) -> np.ndarray:
        return self.absorption + self.scattering


def asked(doc: str, scene: Path) -> list[Fog]:
    """The fogs named on the command line; those of truths that are there already, if none is."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("fogs", nargs="*", metavar="FOG", help="names below fogs: of the scene; 'default' is fog:")
    names = parser.parse_args().fogs or sorted(path.stem for path in (scene / "truth").glob("*.exr"))
    if not names:
        parser.error("say in which fogs")
    return [fog(scene, name) for name in names]


def fog(scene: Path, name: str) -> Fog:
    """The scene's even grey fog of this name. Raises InputError for one that varies in space or with colour."""
    medium = load_scene(scene / "scene.yaml", fog=None if name == "default" else name).fog
    phase = medium.phase()
    if medium.type != "homogeneous" or phase.type not in ("isotropic", "henyey_greenstein"):
        raise InputError(f"fog '{name}' is {medium.type}, {phase.type}", place=str(scene / "scene.yaml"),
                         remedy="truths are rendered of homogeneous fogs, isotropic or henyey_greenstein")
    found = Fog(name, *medium.coefficients(), getattr(phase, "asymmetry", 0.0))
    if np.ptp(found.absorption) or np.ptp(found.scattering):
        raise InputError(f"fog '{name}' is not grey", place=str(scene / "scene.yaml"), remedy="truths are rendered of grey fogs")
    return found


def write_truth(scene: Path, fog: Fog, radiance: np.ndarray, method: str) -> Path:
    """truth/FOG.exr of linear radiance (H, W, 3) [photo unit]: half floats, compressed with loss below what shows."""
    path = scene / "truth" / f"{fog.name}.exr"
    path.parent.mkdir(exist_ok=True)
    height, width = radiance.shape[:2]
    spec = oiio.ImageSpec(width, height, 3, "half")
    spec.attribute("compression", "dwaa:20")
    spec.attribute("DateTime", "1970:01:01 00:00:00")
    spec.attribute("fog:content", f"rendered truth, linear scene-referred Rec.709; {method}")
    spec.attribute("fog:name", fog.name)
    for name, value in (("absorption_coefficient_per_m", fog.absorption), ("scattering_coefficient_per_m", fog.scattering)):
        spec.attribute(f"fog:{name}", "float[3]", tuple(float(x) for x in value))
    spec.attribute("fog:asymmetry", float(fog.asymmetry))
    with replacing(path) as partial:
        output = oiio.ImageOutput.create(str(partial))
        if not (output.open(str(partial), spec) and output.write_image(np.ascontiguousarray(radiance, np.float32))
                and output.close()):
            raise InputError(output.geterror(), place=str(path), remedy="make the folder writable")
    return path
