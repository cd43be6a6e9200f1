"""Ultra-HDR JPEGs: an 8-bit picture with, behind it in the same file, a JPEG of logarithmic gains.

Adobe Gain Map 1.0 (also Android's "Ultra HDR" 1.0): with encoded gain e in [0, 1]
    log2 gain = GainMapMin + (GainMapMax - GainMapMin) * e ** (1 / Gamma)
    radiance = (base + OffsetSDR) * 2 ** (log2 gain) - OffsetHDR
in linear light, where base is the decoded 8-bit picture. Computed here in float32, since the usual
decoders return half floats by way of tables.
"""

from __future__ import annotations

import re

import cv2
import imagecodecs
import numpy as np

from pipeline.errors import InputError
from pipeline.imaging.colour import SrgbEncoding, profile_encoding

_GAIN_MAP_DEFAULTS = {"GainMapMin": 0.0, "GainMapMax": None, "Gamma": 1.0, "OffsetSDR": 1 / 64,
                      "OffsetHDR": 1 / 64}
_WITHOUT_PAYLOAD = {0x01, *range(0xD0, 0xD9)}  # TEM, the restart markers and SOI


def decode_ultra_hdr(data: bytes) -> np.ndarray:
    """Linear Rec.709 radiance, (H, W, 3) float32, 1 = white of the 8-bit picture.

    The gains apply in full, as on a display without limits. Raises `InputError` if `data` is no JPEG
    with a gain map in Adobe's form, or one whose 8-bit picture is not the darker rendition.
    """
    base_jpeg, gain_jpeg, parameters = _split(data)
    try:
        base = imagecodecs.jpeg8_decode(base_jpeg, outcolorspace="rgb")
        encoded_gain = imagecodecs.jpeg8_decode(gain_jpeg)
    except RuntimeError as error:
        raise InputError(f"damaged JPEG ({error})", remedy="copy the file again") from error
    profile = _icc_profile(base_jpeg)
    linear = (profile_encoding(profile) if profile else SrgbEncoding()).decode(base)
    height, width = linear.shape[:2]
    gain = encoded_gain.reshape(*encoded_gain.shape[:2], -1).astype(np.float32) / 255
    if gain.shape[:2] != (height, width):
        gain = cv2.resize(gain, (width, height), interpolation=cv2.INTER_LINEAR).reshape(height, width, -1)
    low, high = parameters["GainMapMin"], parameters["GainMapMax"]
    log2_gain = low + (high - low) * gain ** (1 / parameters["Gamma"])
    radiance = (linear + parameters["OffsetSDR"]) * np.exp2(log2_gain) - parameters["OffsetHDR"]
    return np.ascontiguousarray(radiance, np.float32)


def _split(data: bytes) -> tuple[bytes, bytes, dict[str, np.ndarray]]:
    """The base JPEG, the gain map's JPEG and the gain map's parameters.

    The JPEGs are told apart by walking each one's segments to its own end, so that neither a
    thumbnail inside a segment nor a wrong multi-picture index leads astray.
    """
    start, end = 0, _end_of_jpeg(data, 0)
    base = data[start:end]
    while (start := data.find(b"\xff\xd8\xff", end)) >= 0:
        end = _end_of_jpeg(data, start)
        parameters = _gain_map_parameters(data[start:end])
        if parameters is not None:
            return base, data[start:end], parameters
    raise InputError("no gain map in this JPEG", remedy="give an Ultra-HDR JPEG (gain map of Adobe's form)")


def _segments(jpeg: bytes, start: int):
    """Yields (marker, payload start, payload end) of each segment up to and with start of scan."""
    if jpeg[start:start + 2] != b"\xff\xd8":
        raise InputError("not a JPEG file", remedy="give an Ultra-HDR JPEG")
    position = start + 2
    while position + 4 <= len(jpeg) and jpeg[position] == 0xFF:
        marker = jpeg[position + 1]
        if marker == 0xFF:  # fill byte
            position += 1
        elif marker in _WITHOUT_PAYLOAD:
            position += 2
        else:
            end = position + 2 + int.from_bytes(jpeg[position + 2:position + 4], "big")
            yield marker, position + 4, end
            if marker == 0xDA:
                return
            position = end
    raise InputError("truncated or damaged JPEG", remedy="copy the file again")


def _end_of_jpeg(data: bytes, start: int) -> int:
    """Offset behind the end marker. In coded data 0xFF is stuffed, so that 0xFFD9 can only be the end."""
    *_, (_, _, scan) = _segments(data, start)
    end = data.find(b"\xff\xd9", scan)
    if end < 0:
        raise InputError("truncated JPEG: its end marker is missing", remedy="copy the file again")
    return end + 2


def _gain_map_parameters(jpeg: bytes) -> dict[str, np.ndarray] | None:
    """hdrgm parameters of the XMP, each a float32 scalar or (3,), or None without a gain map."""
    xmp = b"".join(jpeg[begin:end] for marker, begin, end in _segments(jpeg, 0)
                   if marker == 0xE1 and jpeg[begin:end].startswith(b"http://ns.adobe.com/xap/1.0/\0"))
    text = xmp.decode("utf-8", "replace")
    if "hdrgm:GainMapMax" not in text:
        return None
    if re.search(r'hdrgm:BaseRenditionIsHDR\s*(=\s*"|>)\s*True', text):
        raise InputError("the gain map darkens an HDR picture",
                         remedy="give a JPEG whose base picture is SDR")
    return {name: _parameter(text, name, default) for name, default in _GAIN_MAP_DEFAULTS.items()}


def _parameter(xmp: str, name: str, default: float | None) -> np.ndarray:
    """One value as an XMP attribute, or one per channel as a sequence."""
    if attribute := re.search(rf'hdrgm:{name}\s*=\s*["\']([^"\']*)["\']', xmp):
        numbers = [attribute[1]]
    elif element := re.search(rf"<hdrgm:{name}\b[^>]*>(.*?)</hdrgm:{name}>", xmp, re.DOTALL):
        numbers = re.findall(r"<rdf:li[^>]*>(.*?)</rdf:li>", element[1], re.DOTALL) or [element[1]]
    else:
        numbers = [default]
    try:
        values = np.array(numbers, np.float32)
    except (TypeError, ValueError):
        values = np.array([np.nan], np.float32)
    is_usable = values.size in (1, 3) and np.isfinite(values).all()
    if name == "Gamma":
        is_usable = is_usable and (values > 0).all()
    if not is_usable:
        raise InputError(f"gain map parameter hdrgm:{name} = {', '.join(map(str, numbers))}",
                         remedy="give one finite number, or three (Gamma positive)")
    return values if values.size == 3 else values[0]


def _icc_profile(jpeg: bytes) -> bytes:
    """The profile of the APP2 segments, put together in the order of their numbers; b"" without one."""
    chunks = [jpeg[begin:end] for marker, begin, end in _segments(jpeg, 0)
              if marker == 0xE2 and jpeg[begin:end].startswith(b"ICC_PROFILE\0")]
    return b"".join(chunk[14:] for chunk in sorted(chunks, key=lambda chunk: chunk[12]))
