"""What a match found, as numbers for a file, words for a screen, and pictures."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from pipeline.estimation.fog_match import Match
from pipeline.imaging.display import displayed
from pipeline.imaging.strip import strip
from pipeline.physics.visibility import CONTRAST

#: By so much differences are enlarged, of what a screen shows; where nothing was compared.
ENLARGED, LEFT_OUT = 5, (70, 90, 150)
#: Small pictures are shown so many times as large.
SHOWN = 2


def visibility_of(extinction: float) -> float:
    return float(-np.log(CONTRAST) / extinction)


def numbers(found: Match, lights: list[str], unexplained: float) -> dict[str, Any]:
    """JSON of the match: values are null where nothing determines them, ends of intervals where they are open."""
    determined, asked = found.determined, found.asked
    thinnest, densest = found.open_ends
    low, high = found.interval

    def value(known: bool, one: Any) -> Any:
        return one if known else None

    gains = {name: {"value": value(bool(known), float(gain)), "relative_standard_error": float(error), "determined": bool(known)}
             for name, gain, error, known in zip(lights, found.gains, found.gain_error, found.determined_gains)}
    stops = np.log2(found.exposure)
    return {
        "visibility_m": {"value": value(determined["visibility"], visibility_of(found.extinction)),
                         "interval_95": [value(not densest, visibility_of(high)), value(not thinnest, visibility_of(low))],
                         "determined": determined["visibility"]},
        "extinction_coefficient_per_m": {"value": value(determined["visibility"], found.extinction),
                                         "interval_95": [value(not thinnest, low), value(not densest, high)],
                                         "determined": determined["visibility"]},
        "single_scattering_albedo": {"asked": asked.fit_albedo, "value": value(determined["albedo"], found.albedo),
                                     "standard_error": found.albedo_error, "determined": determined["albedo"]},
        "asymmetry": {"asked": asked.fit_asymmetry, "value": value(determined["asymmetry"], found.asymmetry),
                      "standard_error": found.asymmetry_error, "determined": determined["asymmetry"]},
        "light_gains": {"asked": asked.fit_gains, **gains},
        "exposure_ev": {"value": value(determined["exposure"], float(stops.mean())), "determined": determined["exposure"],
                        "standard_error": float(found.exposure_error.mean() / np.log(2))},
        "white_balance": {"value": value(determined["exposure"], 2.0 ** (stops - stops.mean())),
                          "determined": determined["exposure"]},
        "unexplained_share": unexplained, "typical_residual_of_expected": found.spread,
        "error_variance_by_correlation": float(found.correlated)}


def words(found: Match, lights: list[str], unexplained: float) -> list[str]:
    """The same for a person."""
    known, asked = found.determined, found.asked
    lines = [visibility_in_words(found)]
    if asked.fit_albedo:
        lines.append("albedo " + (_several(found.albedo, found.albedo_error) if known["albedo"] else "not determined"))
    if asked.fit_asymmetry:
        lines.append(f"g {found.asymmetry:.2f} +- {1.96 * found.asymmetry_error:.2g}" if known["asymmetry"] else "g not determined")
    if asked.fit_gains:
        lines.append("gains " + ", ".join(
            f"{name} {gain:.3g} +- {1.96 * error * gain:.2g}" if sure else f"{name} not determined"
            for name, gain, error, sure in zip(lights, found.gains, found.gain_error, found.determined_gains))
            + ("; their mean is 1 as far as an albedo of 1 allows" if asked.fit_albedo else ""))
    stops = np.log2(found.exposure)
    lines.append(f"exposure {stops.mean():+.2f} EV, white balance " + " ".join(f"{x:.3f}" for x in 2.0 ** (stops - stops.mean()))
                 if known["exposure"] else "exposure not determined: nothing near enough is seen")
    lines.append(f"unexplained: {unexplained:.1%} of the reference (root mean square)")
    return lines


def visibility_in_words(found: Match) -> str:
    thinnest, densest = found.open_ends
    near, far = (visibility_of(extinction) for extinction in found.interval[::-1])
    if thinnest and densest:
        return "visibility not determined"
    if thinnest:
        return f"visibility not determined: {near:.3g} m or more; no fog would do as well"
    if densest:
        return f"visibility not determined: {far:.3g} m or less; any denser fog would do as well"
    if not found.determined["visibility"]:
        return f"visibility not determined: anything from {near:.3g} to {far:.3g} m"
    return f"visibility {visibility_of(found.extinction):.4g} m (95 %: {near:.4g} to {far:.4g} m)"


def _several(values: np.ndarray, errors: np.ndarray) -> str:
    return " ".join(f"{value:.3f}" for value in values) + f" +- {1.96 * float(np.max(errors)):.2g}"


def fog_of(found: Match, phase: dict[str, Any]) -> dict[str, Any]:
    """The match as a scene file's fog."""
    fog: dict[str, Any] = {"type": "homogeneous", "visibility": float(f"{visibility_of(found.extinction):.4g}")}
    albedo = [round(float(one), 4) for one in found.albedo]
    if albedo != [1.0, 1.0, 1.0]:
        fog["single_scattering_albedo"] = albedo
    return {**fog, "phase_function": {**phase, "asymmetry": round(found.asymmetry, 3)} if found.asked.fit_asymmetry else phase}


def settings_of(found: Match, lights: list[str], stated: dict[str, float]) -> list[str]:
    """What besides the fog makes the reference again, as values for the command line; `stated` gains of the scene."""
    settings = [f"lights.{name}.gain={stated.get(name, 1.0) * gain:.3g}" for name, gain in zip(lights, found.gains)
                if found.asked.fit_gains and name in stated and abs(np.log(gain)) > 0.01]
    ev = float(np.log2(found.exposure).mean())
    return settings + ([f"composite.exposure={ev:.2f}"] if abs(ev) > 0.01 else [])


def pictures(clear: np.ndarray, reference: np.ndarray, ours: np.ndarray, used: np.ndarray, exposure: float, lines: list[str]
             ) -> tuple[np.ndarray, np.ndarray]:
    """residual.png, and all side by side; (H, W, 3) linear, `used` (H, W)."""
    shown = [cv2.resize(displayed(np.maximum(one, 0), exposure), None, fx=SHOWN, fy=SHOWN, interpolation=cv2.INTER_CUBIC)
             for one in (clear, reference, ours)]
    seen, made = (displayed(np.maximum(one, 0), exposure).astype(float) for one in (reference, ours))
    residual = np.clip(128 + ENLARGED * (seen - made), 0, 255).round().astype(np.uint8)
    residual[~used] = LEFT_OUT
    residual = cv2.resize(residual, None, fx=SHOWN, fy=SHOWN, interpolation=cv2.INTER_NEAREST)
    captions = [["clear", "the photograph"], ["reference", "in fog"], ["ours", *lines],
                [f"reference - ours, x {ENLARGED}", "grey: none; blue: left out"]]
    return residual, strip(list(zip([*shown, residual], captions)))
