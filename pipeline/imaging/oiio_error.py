"""What OpenImageIO says went wrong."""

from __future__ import annotations


def oiio_error(source) -> str:
    """The last error of the library itself, or of one of its readers, in one line; "" where there is none.

    A damaged file's own bytes may stand in it, which are no text.
    """
    try:
        return " ".join(source.geterror().split())
    except UnicodeDecodeError:
        return "its header holds no text where there should be some"
