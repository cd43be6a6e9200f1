"""A scene's images as a screen shows them."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.imaging.canvas import Canvas
from pipeline.imaging.display import FLOAT_KINDS, depth_picture, display_exposure, displayed, tone_factor
from pipeline.imaging.maps import read_map
from pipeline.imaging.overlay import COLOURS, overlay
from pipeline.imaging.overlay_lines import cast_window
from pipeline.paths import Build
from pipeline.plugins.lights.sun import Sun
from pipeline.scene.artefacts import read_json, read_placed


class Pictures:
    """(H, W, 3) uint8 RGB each, of one scene and fog that were made."""

    def __init__(self, build: Build):
        self.build = build
        self.radiance = read_map(build.photograph)
        floating = read_json(build.photograph_facts)["suffix"] in FLOAT_KINDS
        self.exposure = display_exposure(self.radiance) if floating else 1.0

    def photograph(self) -> np.ndarray:
        return displayed(self.radiance, self.exposure)

    def foggy(self) -> np.ndarray:
        return displayed(read_map(self.build.foggy(".exr")), self.exposure)

    def transmittance(self) -> np.ndarray:
        return displayed(read_map(self.build.transmittance))

    def in_scattering(self, light: str | None = None) -> np.ndarray:
        """V, in the photograph's exposure; that of one light as bright as it may be."""
        values = read_map(self.build.in_scattering(light))
        return displayed(values, tone_factor(values) if light else self.exposure)

    def depth(self) -> np.ndarray:
        sky = read_json(self.build.geometry).get("sky_depth_m")
        return depth_picture(read_map(self.build.depth), sky)[0]

    def annotated(self) -> np.ndarray:
        return cv2.imread(str(self.build.overlay), cv2.IMREAD_COLOR)[..., ::-1]

    def cast(self, direction: np.ndarray | None) -> np.ndarray:
        """Windows and the patches that they throw, and where the windows' light falls along `direction`."""
        scene = read_placed(self.build)
        canvas = Canvas(self.photograph(), scene.camera, read_map(self.build.depth))
        for sun in (light for light in scene.lights.values() if isinstance(light, Sun)):
            for opening in sun.openings.values():
                patches = [patch.polygon for patch in opening.patches]
                for patch in patches:
                    canvas.polygon(patch, COLOURS["patch"], "", width=4.0)
                canvas.polygon(opening.window.polygon, COLOURS["window"], "")
                for outline in cast_window(opening.window.polygon, direction, patches) if direction is not None else []:
                    if len(outline) >= 3:
                        canvas.polygon(outline, COLOURS["cast"], "", fill=0.2, width=2.0)
        return canvas.finished()

    def shaft(self) -> np.ndarray:
        """What `annotated` draws of the sun and its volume."""
        scene = read_placed(self.build)
        suns = {name: light for name, light in scene.lights.items() if isinstance(light, Sun)}
        return overlay(self.photograph(), scene.camera, {}, suns, read_map(self.build.depth))
