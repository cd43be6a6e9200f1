"""Pictures side by side, each with lines of text below it."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

FONT = cv2.FONT_HERSHEY_SIMPLEX
#: Picture widths [pixel] between which panels are fitted, and width of the whole.
NARROWEST, WIDEST, WHOLE = 160, 640, 3600
PAPER, INK = (255, 255, 255), ((30, 30, 30), (110, 110, 110))
#: So many panels a row, at most.
A_ROW = 6


def strip(panels: Sequence[tuple[np.ndarray, Sequence[str]]]) -> np.ndarray:
    """Panels (picture (h, w, 3) uint8 of one size, lines of text) on white paper, (H, W, 3) uint8.

    The first line stands in black, the others in grey. More than six panels take further rows, evenly filled.
    """
    rows = -(-len(panels) // A_ROW)
    columns = -(-len(panels) // rows)
    height, width = panels[0][0].shape[:2]
    shown = int(np.clip(width, NARROWEST, min(WIDEST, WHOLE // columns - 16)))
    size = (shown, max(1, round(height * shown / width)))
    gap, line = max(4, shown // 40), max(14, shown // 18)
    below = line * max(len(text) for _, text in panels) + gap
    sheet = np.full((rows * (size[1] + below + gap) + gap, columns * (shown + gap) + gap, 3), PAPER, np.uint8)
    for number, (picture, text) in enumerate(panels):
        top = gap + number // columns * (size[1] + below + gap)
        left = gap + number % columns * (shown + gap)
        method = cv2.INTER_AREA if shown < width else cv2.INTER_NEAREST
        sheet[top : top + size[1], left : left + shown] = cv2.resize(picture, size, interpolation=method)
        for k, words in enumerate(text):
            _write(sheet, words, (left, top + size[1] + (k + 1) * line), shown, line, INK[min(k, 1)])
    return sheet


def _write(sheet: np.ndarray, words: str, at: tuple[int, int], room: int, line: int, colour: tuple) -> None:
    scale = 0.7 * line / cv2.getTextSize("Ag", FONT, 1.0, 1)[0][1]
    scale *= min(1.0, room / max(1, cv2.getTextSize(words, FONT, scale, 1)[0][0]))
    cv2.putText(sheet, words, at, FONT, scale, colour, 1, cv2.LINE_AA)
