"""The paper's validation (section 6.1), and what it leaves out.

    python -m tests.validation [--size 64]

writes build/validation/, or --folder: fig8.png and fig9.png (truth, composite, difference times five), mse.csv and fig10.png (mean
square error of the composite against absorption and scattering, values clipped to [0, 1] as in the paper); then, with
light that surfaces reflect and fog scatters again, all_light.png, all_light.csv and all_light_mse.png, and shares.png and
shares.csv (how much of the fog's light single scattering has, against optical depth).
"""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.paths import PROJECT
from tests.validation import all_light, approximations

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="tests.validation")
    parser.add_argument("--size", type=int, default=64, help="pixels a side")
    parser.add_argument("--samples", type=int, default=512, help="paths a pixel, for light of all orders")
    parser.add_argument("--variants", default="", help="settings to compare, with commas between; all of them if left out")
    parser.add_argument("--only", choices=["approximations", "all_light"], help="one experiment")
    parser.add_argument("--folder", type=Path, default=PROJECT / "build/validation", help="where it writes")
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if options.only != "all_light":
        approximations.run(options.size, folder, options.variants.split(",") if options.variants else None)
    if options.only != "approximations":
        all_light.run(options.size, options.samples, folder)
