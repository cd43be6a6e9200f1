"""Between the code values of a file and linear, scene-referred Rec.709 (D65) radiance.

An encoding has two inverse methods. `decode` takes integer codes or floats where 1 is the top code,
(H, W, n), and gives (H, W, 3) float32; `encode` takes (H, W, 3) linear and gives (H, W, n) float32,
1 the top code, not clipped. n is 1 (grey) or 3. Colours outside Rec.709 become negative in linear
light instead of being clipped, so that a wide-gamut photograph survives the round trip.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import imagecodecs
import numpy as np

from pipeline.errors import InputError

#: Names that a scene may give as `colour_space`.
COLOUR_SPACES = ("auto", "srgb", "linear", "display_p3", "adobe_rgb")

#: Rows decoded at once.
BAND = 256
_D65 = (0.3127, 0.3290, 1.0)
_REC709_PRIMARIES = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06)
_DISPLAY_P3_PRIMARIES = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060)


def srgb_to_linear(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 decoding; odd-symmetric for negative values, unbounded above 1."""
    encoded = np.asarray(encoded)
    size = np.abs(encoded)
    linear = np.where(size <= 0.04045, size / 12.92, ((size + 0.055) / 1.055) ** 2.4)
    return np.copysign(linear, encoded).astype(np.result_type(encoded, np.float32))


def linear_to_srgb(linear: np.ndarray) -> np.ndarray:
    """Inverse of `srgb_to_linear`."""
    linear = np.asarray(linear)
    size = np.abs(linear)
    encoded = np.where(size <= 0.04045 / 12.92, size * 12.92, 1.055 * size ** (1 / 2.4) - 0.055)
    return np.copysign(encoded, linear).astype(np.result_type(linear, np.float32))


def _as_rgb(values: np.ndarray) -> np.ndarray:
    return np.repeat(values, 3, axis=-1) if values.shape[-1] == 1 else values


@dataclass(frozen=True)
class SrgbEncoding:
    """The sRGB transfer function; `profile` is embedded again when the file carried one."""

    profile: bytes | None = None

    def decode(self, codes: np.ndarray) -> np.ndarray:
        if codes.dtype.kind == "u":  # a table is exact and, over a photograph, ten times faster
            top = np.iinfo(codes.dtype).max
            table = srgb_to_linear(np.arange(top + 1, dtype=np.float64) / top).astype(np.float32)
            linear = np.empty((*codes.shape[:2], 3), np.float32)
            for row in range(0, len(codes), BAND):  # indices are widened to eight bytes each
                linear[row:row + BAND] = _as_rgb(table[codes[row:row + BAND]])
            return linear
        return _as_rgb(srgb_to_linear(codes.astype(np.float32)))

    def encode(self, linear: np.ndarray, channels: int) -> np.ndarray:
        return linear_to_srgb(linear[..., :channels])


@dataclass(frozen=True)
class LinearEncoding:
    """Values that already are linear Rec.709."""

    profile: bytes | None = None

    def decode(self, codes: np.ndarray) -> np.ndarray:
        return _as_rgb(_unit(codes))

    def encode(self, linear: np.ndarray, channels: int) -> np.ndarray:
        return linear[..., :channels]


@dataclass(frozen=True)
class ProfileEncoding:
    """An ICC profile, evaluated in float by Little CMS, relative colorimetric.

    Matrix profiles are unbounded: nothing is clipped. Profiles made of look-up tables clip to their
    own range. `embedded` is False where the profile stands for something that is no ICC profile in
    the file (a colour space named by the scene, the chromaticities of an EXR).
    """

    icc: bytes
    embedded: bool = True

    @property
    def profile(self) -> bytes | None:
        return self.icc if self.embedded else None

    @cached_property
    def colour_model(self) -> str:
        return "gray" if self.icc[16:20] == b"GRAY" else "rgb"

    def decode(self, codes: np.ndarray) -> np.ndarray:
        values = _unit(codes)
        if self.colour_model == "gray":
            values = values[..., :1]
        elif values.shape[-1] == 1:
            values = _as_rgb(values)
        return self._transform(values, self.icc, _linear_rec709(), self.colour_model, "rgb")

    def encode(self, linear: np.ndarray, channels: int) -> np.ndarray:
        values = self._transform(linear, _linear_rec709(), self.icc, "rgb", self.colour_model)
        return values[..., :channels]

    @staticmethod
    def _transform(values: np.ndarray, source: bytes, target: bytes, source_model: str,
                   target_model: str) -> np.ndarray:
        height, width = values.shape[:2]
        # Rows are laid end to end: a single row or column is otherwise ambiguous to the wrapper.
        flat = np.ascontiguousarray(values, np.float32).reshape(-1, 1, values.shape[-1])
        result = imagecodecs.cms_transform(
            flat if source_model == "rgb" else flat[..., 0], source, target, colorspace=source_model,
            outcolorspace=target_model, outdtype="float32",
            intent=imagecodecs.CMS.INTENT.RELATIVE_COLORIMETRIC)
        return np.asarray(result, np.float32).reshape(height, width, -1)


Encoding = SrgbEncoding | LinearEncoding | ProfileEncoding


def named_encoding(colour_space: str) -> Encoding:
    """The encoding of a name other than "auto"; an unknown name raises `InputError`."""
    if colour_space == "srgb":
        return SrgbEncoding()
    if colour_space == "linear":
        return LinearEncoding()
    if colour_space == "display_p3":
        transfer = srgb_to_linear(np.linspace(0, 1, 4096)) * 65535
        return ProfileEncoding(imagecodecs.cms_profile(
            "rgb", whitepoint=_D65, primaries=_DISPLAY_P3_PRIMARIES,
            transferfunction=np.rint(transfer).astype(np.uint16)), embedded=False)
    if colour_space == "adobe_rgb":
        return ProfileEncoding(imagecodecs.cms_profile("adobergb"), embedded=False)
    raise InputError(f"unknown colour_space {colour_space!r}",
                     remedy=f"use one of {', '.join(COLOUR_SPACES)}")


def profile_encoding(icc: bytes) -> Encoding:
    """The encoding that an embedded ICC profile describes.

    A profile that agrees with sRGB within half an 8-bit code is read by sRGB's own formula,
    which is exact both ways. A profile that is damaged or of another colour model (CMYK, Lab) raises
    `InputError`.
    """
    if icc[16:20] not in (b"RGB ", b"GRAY"):
        model = icc[16:20].decode("latin-1").strip()
        raise InputError(f"the embedded ICC profile is of colour model {model!r}",
                         remedy="convert the photograph to RGB or grey, or set colour_space")
    encoding = ProfileEncoding(bytes(icc))
    levels = np.linspace(0, 1, 9, dtype=np.float32)
    if encoding.colour_model == "rgb":
        probe = np.stack(np.meshgrid(levels, levels, levels), -1).reshape(1, -1, 3)
    else:
        probe = levels.reshape(1, -1, 1)
    try:
        decoded = encoding.decode(probe)
    except (RuntimeError, ValueError) as error:
        raise InputError(f"the embedded ICC profile cannot be used ({error})",
                         remedy="remove the profile or set colour_space") from error
    if np.abs(linear_to_srgb(decoded) - probe).max() < 0.5 / 255:
        return SrgbEncoding(bytes(icc))
    return encoding


def chromaticities_encoding(chromaticities: np.ndarray) -> Encoding:
    """Linear light with the eight chromaticities of an EXR header (red, green, blue, white: x, y)."""
    chromaticities = np.asarray(chromaticities, float).ravel()
    if np.allclose(chromaticities, _REC709_PRIMARIES + _D65[:2], atol=1e-3):  # headers round to 3-4 digits
        return LinearEncoding()
    try:
        return ProfileEncoding(imagecodecs.cms_profile(
            "rgb", whitepoint=(*chromaticities[6:], 1.0), primaries=tuple(chromaticities[:6]), gamma=1.0),
            embedded=False)
    except (RuntimeError, ValueError) as error:  # three points that span no triangle, or numbers that are none
        raise InputError(f"chromaticities {np.round(chromaticities, 4).tolist()} are of no colour space ({error})",
                         remedy="remove them, or set colour_space") from None


def _linear_rec709() -> bytes:
    return imagecodecs.cms_profile("rgb", whitepoint=_D65, primaries=_REC709_PRIMARIES, gamma=1.0)


def _unit(codes: np.ndarray) -> np.ndarray:
    """Codes as float32 with the top code at 1."""
    if codes.dtype.kind == "u":
        return codes.astype(np.float32) / np.float32(np.iinfo(codes.dtype).max)
    return codes.astype(np.float32)
