"""What a person did wrong, said in one line.

Everything below raises `InputError` for a mistake that a person can mend; the command line prints
its one line and exits with status 2. Any other exception is a bug of ours and keeps its traceback.
"""

from __future__ import annotations

import difflib

#: Characters of a problem or of a remedy; longer ones lose their middle.
LONGEST = 500


class InputError(Exception):
    """A mistake in a scene file, a photograph, a template, the command line or the machine's set-up.

    `place` is where it stands (file, or file:line), `problem` what is wrong together with the
    offending value, `remedy` what to do about it.
    """

    def __init__(self, problem: str, *, remedy: str, place: str | None = None):
        self.place, self.problem, self.remedy = place, _one_line(problem), _one_line(remedy)
        super().__init__(f"{place + ': ' if place else ''}{self.problem}; {self.remedy}")

    def at(self, place: str) -> "InputError":
        """The same mistake with its place filled in by a caller who knows the file."""
        return self if self.place else InputError(self.problem, remedy=self.remedy, place=place)


def nearest(word: str, among: list[str]) -> str:
    """" (did you mean 'x'?)" with the one of `among` most alike, or nothing."""
    near = difflib.get_close_matches(word, among, n=1, cutoff=0.6)
    return f" (did you mean '{near[0]}'?)" if near else ""


def _one_line(text: str) -> str:
    """Without what would break the line or command a terminal, and short enough to be read.

    Values and names of a stranger's scene stand in messages.
    """
    line = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in " ".join(text.split()))
    return line if len(line) <= LONGEST else line[:LONGEST - 150] + " ... " + line[-145:]
