"""What was asked of the plan, what it expected, and what came of it."""

from __future__ import annotations

from typing import Any

#: Stages that a plan's seconds are about.
OF_THE_FOG = ("plan", "emit", "render", "decompose", "composite")
#: Of the expected time, beyond which the machine is not as the plan takes it to be; and seconds that do not count.
SLOWER, AT_LEAST = 1.5, 2.0


def outcome(plan: dict[str, Any], maps: dict[str, Any], seconds: dict[str, float]) -> dict[str, Any] | None:
    """Asked, expected and actual; None where the fog is clear and nothing was planned.

    seconds: of the stages [s]; those that were not repeated count with what they took when they ran.
    """
    expected = plan["expected"]
    if expected is None:
        return None
    error = maps.get("estimated_error")
    return {"asked": expected["asked"], "calibration": expected["calibration"],
            "expected_seconds": expected["seconds"], "seconds": sum(seconds.get(one, 0.0) for one in OF_THE_FOG),
            "expected_relative_error": expected["relative_error"],
            "relative_error": error["relative_error"] if error else None,
            "relative_error_at_most": error["at_most"] if error else None,
            "relative_error_of_transmittance": error["transmittance"] if error else None,
            "relative_error_of_in_scattering": error["in_scattering"] if error else None,
            "checked_pixels": error["pixels"] if error else 0}


def in_words(found: dict[str, Any]) -> str:
    took = f"plan to composite took {found['seconds']:.1f} s, {found['expected_seconds']:.1f} s expected"
    if found["relative_error"] is None:
        return took
    return (f"{took}; relative error {found['relative_error']:.2g} by {found['checked_pixels']} pixels made as finely as it"
            f" takes, at most {found['relative_error_at_most']:.2g}; {found['expected_relative_error']:.2g} expected")


def shortcomings(found: dict[str, Any] | None) -> list[dict[str, str]]:
    """Where what was asked was not met, and what to do."""
    told = []
    if found is None:
        return told
    tolerance, error = found["asked"].get("tolerance"), found["relative_error"]
    if tolerance is not None and error is not None and error > tolerance:
        told.append(f"the relative error is about {error:.2g}, above the {tolerance:g} asked: ask for tolerance="
                    f"{max(tolerance**2 / error, 1e-4):.2g}")
    budget = found["asked"].get("budget", found["expected_seconds"])
    if found["seconds"] > SLOWER * max(budget, AT_LEAST):
        told.append(f"it took {found['seconds']:.1f} s, {budget:.1f} s were planned: run make calibrate while nothing else"
                    " does, so that the plan knows this machine")
    return [{"stage": "plan", "text": text} for text in told]
