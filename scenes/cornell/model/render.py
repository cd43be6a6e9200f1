"""Re-render the photograph of `cornell` and `cornell_height` from cornell.pov.

    python scenes/cornell/model/render.py

writes photograph.exr of both scenes: linear, in the lamp's radiance unit, sampled at pixel centres.
"""

from __future__ import annotations

import sys
from pathlib import Path

MODEL = Path(__file__).resolve().parent
sys.path.insert(0, str(MODEL.parents[1]))  # so that the script runs from anywhere, uninstalled

from modelled import rendered, write_exr  # noqa: E402

SIZE = 256

if __name__ == "__main__":
    photograph = rendered(MODEL / "cornell.pov", SIZE, SIZE)
    for scene in ("cornell", "cornell_height"):
        write_exr(MODEL.parents[1] / scene / "photograph.exr", photograph)
