"""Photographs from files: upright linear radiance, alpha, clipped pixels and EXIF focal length."""

from __future__ import annotations

import os
from pathlib import Path

import imagecodecs
import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.imaging.colour import (
    Encoding, LinearEncoding, SrgbEncoding, chromaticities_encoding, named_encoding, profile_encoding)
from pipeline.imaging.display_window import in_display_window
from pipeline.imaging.oiio_error import oiio_error
from pipeline.imaging.photograph_file import SUFFIXES, Photograph

#: Photographs with more pixels are refused from their header, before any pixel is decoded.
MAX_PIXELS = 100_000_000
#: A float that says more than this is no light but damage: the sun's disc is some 1e5 times photo white.
BRIGHTEST = 1e9
#: Of layered EXR files, whose channels are all decoded to find R, G, B among them.
MAX_CHANNELS = 64
_SAMPLE_TYPES = {oiio.UINT8: "uint8", oiio.UINT16: "uint16", oiio.HALF: "half", oiio.FLOAT: "float",
                 oiio.DOUBLE: "float"}
#: Diagonal of the 36 x 24 mm frame that 35 mm equivalents refer to [mm] (CIPA DCG-001).
_FULL_FRAME_DIAGONAL = 43.267


def read(path: str | os.PathLike, colour_space: str = "auto", max_pixels: int = MAX_PIXELS) -> Photograph:
    """The photograph at `path`.

    `colour_space` is one of `colour.COLOUR_SPACES`. "auto": an embedded ICC profile (or the
    chromaticities of an EXR) wins; without one, integer files are sRGB and float files linear Rec.709.
    Only R, G, B (or Y) and alpha are read: further channels, pages and gain maps stay behind.
    Raises `InputError` for everything that is not a whole photograph of a known kind.
    """
    path = Path(path)
    try:
        return _read(_opened(path), path, colour_space, max_pixels)
    except InputError as error:
        raise error.at(str(path)) from None


def read_size(path: str | os.PathLike) -> tuple[int, int]:
    """Width and height [pixel] of the photograph as `read` gives it, upright; no pixel is decoded."""
    path = Path(path)
    try:
        source = _opened(path)
    except InputError as error:
        raise error.at(str(path)) from None
    spec = source.spec()
    size = (spec.full_width, spec.full_height) if source.format_name() == "openexr" else (spec.width, spec.height)
    return size[::-1] if spec.get_int_attribute("Orientation", 1) >= 5 else size


def _opened(path: Path) -> oiio.ImageInput:
    if not path.exists():
        raise InputError("no such file", remedy="check the path of the photograph")
    if path.is_dir():
        raise InputError("is a folder", remedy="give the photograph's own path")
    if path.stat().st_size == 0:
        raise InputError("the file is empty (0 bytes)", remedy="copy the photograph again")
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)  # otherwise colour codes come back multiplied by alpha
    source = oiio.ImageInput.open(str(path), config)
    if source is None:
        raise InputError(f"not a readable image ({oiio_error(oiio)})",
                         remedy="give a JPEG, PNG, TIFF, EXR or HDR file")
    return source


def _read(source: oiio.ImageInput, path: Path, colour_space: str, max_pixels: int) -> Photograph:
    spec, format = source.spec(), source.format_name()
    if format not in SUFFIXES:
        raise InputError(f"a {format} image", remedy="convert it to JPEG, PNG, TIFF, EXR or HDR")
    pixels = max(spec.width * spec.height, spec.full_width * spec.full_height)
    if pixels > max_pixels:
        raise InputError(f"{spec.width} x {spec.height} = {pixels / 1e6:.1f} megapixels exceed the limit of "
                         f"{max_pixels / 1e6:g}",
                         remedy="raise photograph.max_megapixels or make it smaller")
    if spec.nchannels > MAX_CHANNELS:
        raise InputError(f"{spec.nchannels} channels", remedy=f"save it with {MAX_CHANNELS} at most, which is fixed")
    if "CMYK" in (spec.get_string_attribute("jpeg:ColorSpace"), spec.get_string_attribute("tiff:ColorSpace")):
        raise InputError("a CMYK photograph", remedy="convert it to RGB: ink is no measure of scene light")
    is_ultra_hdr = format == "jpeg" and spec.format.basetype == oiio.HALF
    sample_type = "uint8" if is_ultra_hdr else _SAMPLE_TYPES.get(spec.format.basetype)
    if sample_type is None:
        raise InputError(f"samples of type {spec.format}", remedy="convert to 8 or 16 bit or to float")
    chosen = _channels(spec, colours_only=is_ultra_hdr)
    if is_ultra_hdr:
        codes = _base_rendition(path)
    else:
        stored_type = "float" if sample_type == "half" else sample_type
        codes = source.read_image(0, 0, 0, spec.nchannels, stored_type)
        _refuse_partial(source, codes)
        codes = codes.reshape(spec.height, spec.width, spec.nchannels)[..., chosen]
    if format == "openexr":
        codes = in_display_window(codes, spec)
    codes = np.ascontiguousarray(_upright(codes, spec.get_int_attribute("Orientation", 1)))

    has_alpha = len(chosen) in (2, 4)
    colours = codes[..., :-1] if has_alpha else codes
    encoding = _encoding(spec, colour_space, colours)
    photograph = dict(path=path, codes=codes, format=format, sample_type=sample_type, encoding=encoding,
                      header=spec)
    if codes.dtype.kind == "u":
        top = np.iinfo(codes.dtype).max
        alpha = codes[..., -1].astype(np.float32) / np.float32(top) if has_alpha else None
        result = Photograph(radiance=encoding.decode(colours), alpha=alpha,
                            clipped=(colours == top).any(-1), **photograph)
        if result.has_associated_alpha:
            raise InputError("integer colours multiplied by alpha (associated alpha)",
                             remedy="save the photograph with straight alpha or without transparency")
        return result
    finite = np.isfinite(codes).all(-1)
    valid = np.where(finite[..., None], colours, np.float32(0))
    alpha = np.clip(np.where(finite, codes[..., -1], np.float32(1)), 0, 1) if has_alpha else None
    # a number may leave the range of floats on its way to light, by a transfer function or a tiny alpha
    with np.errstate(over="ignore", invalid="ignore"):
        result = Photograph(radiance=encoding.decode(valid), alpha=alpha, clipped=~finite, **photograph)
        if result.has_associated_alpha:
            np.divide(result.radiance, alpha[..., None], out=result.radiance, where=alpha[..., None] > 0)
    beyond = ~(np.abs(result.radiance) <= BRIGHTEST).all(-1)
    result.radiance[beyond], result.clipped[beyond] = 0, True
    return result


def _channels(spec: oiio.ImageSpec, colours_only: bool) -> list[int]:
    """Indices of the colour channels and, behind them, of alpha. Layers: the first one with colours."""
    names = list(spec.channelnames)
    leaves = [name.rsplit(".", 1)[-1].upper() for name in names]
    if "RY" in leaves:
        raise InputError("luminance-chroma channels (Y, RY, BY)", remedy="save the EXR with R, G, B channels")
    if {"R", "G", "B"} <= set(leaves):
        chosen = [leaves.index(name) for name in "RGB"]
    elif "Y" in leaves or spec.nchannels == 1:
        chosen = [leaves.index("Y") if "Y" in leaves else 0]
    else:
        raise InputError(f"no channels R, G, B or Y among {', '.join(names)}",
                         remedy="save the photograph with R, G, B channels")
    if not colours_only and "A" in leaves:
        chosen.append(leaves.index("A"))
    return chosen


def _base_rendition(path: Path) -> np.ndarray:
    """The 8-bit picture of an Ultra-HDR JPEG, without its gain map: what every viewer shows."""
    try:
        codes = imagecodecs.jpeg8_decode(path.read_bytes(), outcolorspace="rgb")
    except RuntimeError as error:
        raise InputError(f"damaged JPEG ({error})", remedy="copy the photograph again") from error
    return codes


def _refuse_partial(source: oiio.ImageInput, codes: np.ndarray | None) -> None:
    """A cut-off JPEG comes back half grey, with only the reader's error flag set."""
    if not source.has_error and codes is not None:
        return
    message = oiio_error(source)
    if codes is not None and "extraneous bytes" in message:  # harmless padding that some cameras write
        return
    raise InputError(f"truncated or damaged ({message})", remedy="copy the photograph again")


def _upright(image: np.ndarray, orientation: int) -> np.ndarray:
    """EXIF 2.32, tag 274: 1 upright, 3 upside down, 6 and 8 turned, 2, 4, 5 and 7 also mirrored."""
    if orientation == 2:
        return image[:, ::-1]
    if orientation == 3:
        return image[::-1, ::-1]
    if orientation == 4:
        return image[::-1]
    if orientation == 5:
        return image.swapaxes(0, 1)
    if orientation == 6:
        return np.rot90(image, -1)
    if orientation == 7:
        return image[::-1, ::-1].swapaxes(0, 1)
    if orientation == 8:
        return np.rot90(image)
    return image


def _encoding(spec: oiio.ImageSpec, colour_space: str, colours: np.ndarray) -> Encoding:
    if colour_space != "auto":
        return named_encoding(colour_space)
    profile = spec.getattribute("ICCProfile")
    if profile is not None:
        return profile_encoding(np.asarray(profile, np.uint8).tobytes())
    if colours.dtype.kind == "f":
        chromaticities = spec.getattribute("chromaticities")
        return LinearEncoding() if chromaticities is None else chromaticities_encoding(chromaticities)
    if spec.get_string_attribute("oiio:ColorSpace").startswith("lin"):  # a PNG that declares gamma 1
        return LinearEncoding()
    return SrgbEncoding()


def read_exif_focal_length(path: str | os.PathLike) -> float | None:
    """35 mm-equivalent focal length [mm] by the EXIF data, or None where they do not tell.

    Either stated by the camera, or the focal length times the ratio of the 35 mm frame's diagonal
    to the sensor's, whose pixels per length the focal-plane resolution gives.
    """
    path = Path(path)
    try:
        spec = _opened(path).spec()
    except InputError as error:
        raise error.at(str(path)) from None
    equivalent = spec.get_float_attribute("Exif:FocalLengthIn35mmFilm", 0)
    if equivalent > 0:  # 0 stands for unknown
        return equivalent
    focal_length = spec.get_float_attribute("Exif:FocalLength", 0)
    resolution = spec.get_float_attribute("Exif:FocalPlaneXResolution", 0)
    unit = {2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}.get(spec.get_int_attribute("Exif:FocalPlaneResolutionUnit", 2))
    if not (focal_length > 0 and resolution > 0 and unit):
        return None
    width = spec.get_int_attribute("Exif:PixelXDimension", 0) or spec.width
    height = spec.get_int_attribute("Exif:PixelYDimension", 0) or spec.height
    return focal_length * _FULL_FRAME_DIAGONAL / (np.hypot(width, height) * unit / resolution)
