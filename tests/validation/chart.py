"""Curves on a logarithmic scale, drawn without a plotting library."""

from __future__ import annotations

import cv2
import numpy as np

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 640, 640, 80, 20, 50, 270
#: Told apart also by the colour-blind (Okabe and Ito 2008), and by their marks; BGR.
COLOURS = [(0, 0, 0), (178, 114, 0), (115, 158, 0), (0, 94, 213), (167, 121, 204), (0, 159, 230), (233, 180, 86),
           (66, 228, 240), (120, 120, 120)]
MARKS = [cv2.MARKER_CROSS, cv2.MARKER_TILTED_CROSS, cv2.MARKER_STAR, cv2.MARKER_DIAMOND, cv2.MARKER_SQUARE,
         cv2.MARKER_TRIANGLE_UP, cv2.MARKER_TRIANGLE_DOWN]
FONT = cv2.FONT_HERSHEY_SIMPLEX


def chart(title: str, x: list[float], curves: dict[str, list[float]], *, logarithmic: bool = False) -> np.ndarray:
    """(640, 640, 3) BGR: each curve over `x`, its values [1] on a logarithmic scale; what is not above 0 is left out.

    logarithmic: `x` too.
    """
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    values = [v for curve in curves.values() for v in curve if np.isfinite(v) and v > 0]
    low, high = np.floor(np.log10(min(values))), np.ceil(np.log10(max(values)))
    across = np.log10 if logarithmic else float
    span, reach = across(max(x)) - across(min(x)) or 1.0, max(high - low, 1.0)

    def place(a: float, b: float) -> tuple[int, int]:
        return (int(LEFT + (across(a) - across(min(x))) / span * (WIDTH - LEFT - RIGHT)),
                int(HEIGHT - BOTTOM - (np.log10(b) - low) / reach * (HEIGHT - TOP - BOTTOM)))

    cv2.putText(picture, title, (10, 25), FONT, 0.55, (0, 0, 0), 1, cv2.LINE_AA)
    # over few powers of ten also twice and five times each
    levels = [m * 10.0**power for power in range(int(low), int(high) + 1) for m in ((1, 2, 5) if reach <= 2 else (1,))]
    for level in (one for one in levels if one <= 10.0**high * (1 + 1e-9)):
        at = place(min(x), level)
        cv2.line(picture, at, (WIDTH - RIGHT, at[1]), (220, 220, 220), 1)
        cv2.putText(picture, f"{level:.0e}".replace("e-0", "e-").replace("e+00", "") if reach > 2 else f"{level:g}", (15, at[1] + 5), FONT, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    for a in x:
        cv2.putText(picture, f"{a:.2g}", (place(a, 10.0**low)[0] - 12, HEIGHT - BOTTOM + 20), FONT, 0.45, (0, 0, 0), 1, cv2.LINE_AA)
    for k, (name, curve) in enumerate(curves.items()):
        colour, mark = COLOURS[k % len(COLOURS)], MARKS[k % len(MARKS)]
        points = [place(a, b) for a, b in zip(x, curve) if np.isfinite(b) and b > 0]
        cv2.polylines(picture, [np.array(points, np.int32).reshape(-1, 1, 2)], False, colour, 2, cv2.LINE_AA)
        row = HEIGHT - BOTTOM + 50 + 24 * k
        for point in [*points, (LEFT + 10, row - 5)]:
            cv2.drawMarker(picture, point, colour, mark, 10, 2, cv2.LINE_AA)
        cv2.putText(picture, name, (LEFT + 30, row), FONT, 0.5, (0, 0, 0), 1, cv2.LINE_AA)
    return picture
