"""The pipeline's maps by its own make, and what is measured on pictures."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

from pipeline.imaging.maps import read_map
from pipeline.paths import PROJECT
from tests.validation.truth import Fog


def maps(fog: Fog, settings: dict[str, str], build: Path, scenes: Path | None = None) -> tuple[np.ndarray, np.ndarray]:
    """T and V of the pipeline, (H, W, 3), with these values of the scene overridden."""
    command = ["make", "-s", f"scene={fog.scene}", f"fog={fog.name}", f"BUILD={build}",
               *([f"SCENES={scenes}"] if scenes else []), *(f"{key}={value}" for key, value in settings.items())]
    done = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True,
                          env={k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "FOG_"))})
    if done.returncode:
        sys.exit(f"error: {' '.join(command)}: {done.stderr.strip().splitlines()[-1]}")
    out = build / fog.scene / fog.name
    return read_map(out / "transmittance.exr").astype(float), read_map(out / "in_scattering.exr").astype(float)


def mse(one: np.ndarray, other: np.ndarray) -> float:
    """Mean square error of values in [0, 1], as in the paper's Fig. 10."""
    return float(((np.clip(one, 0, 1) - np.clip(other, 0, 1)) ** 2).mean())


def triptych(path: Path, truth: np.ndarray, *composites: np.ndarray, enlarged: int = 4) -> None:
    """Ground truth, then each composite and its difference times five, as a screen shows them."""
    shown = [truth]
    for composite in composites:
        shown += [composite, 5 * np.abs(np.clip(truth, 0, 1) - np.clip(composite, 0, 1))]
    rows = [np.clip(one, 0, 1) ** (1 / 2.2) for one in shown]
    picture = np.round(255 * np.concatenate(rows, axis=1)[..., ::-1]).astype(np.uint8)
    cv2.imwrite(str(path), cv2.resize(picture, None, fx=enlarged, fy=enlarged, interpolation=cv2.INTER_NEAREST))
