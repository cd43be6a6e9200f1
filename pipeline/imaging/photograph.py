"""Photographs in and out: files on one side, upright linear radiance on the other.

Reading gives linear, scene-referred Rec.709 radiance, 1 = photo white, pixels upright (the EXIF
orientation applied): annotations refer to these pixels. Writing takes a radiance of the same size
back into the kind of file that it came from: format, bit depth, colour profile, alpha, metadata.

Kinds: JPEG (8 bit), PNG and TIFF (8 and 16 bit, TIFF also float), OpenEXR, Radiance HDR.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import imagecodecs
import numpy as np
import OpenImageIO as oiio

from pipeline.errors import InputError
from pipeline.imaging.atomic import replacing
from pipeline.imaging.colour import (
    Encoding, LinearEncoding, SrgbEncoding, chromaticities_encoding, named_encoding, profile_encoding)

#: Photographs with more pixels are refused from their header, before any pixel is decoded.
MAX_PIXELS = 100_000_000

_SUFFIXES = {"jpeg": (".jpg", ".jpeg"), "png": (".png",), "tiff": (".tif", ".tiff"), "openexr": (".exr",),
             "hdr": (".hdr",)}
_SAMPLE_TYPES = {oiio.UINT8: "uint8", oiio.UINT16: "uint16", oiio.HALF: "half", oiio.FLOAT: "float",
                 oiio.DOUBLE: "float"}
#: Metadata about pixels as they were stored: false or superfluous beside new pixels. The gain map of
#: an Ultra-HDR photograph (hdrgm and its container) would brighten the fog by the clear picture's lights.
_STALE_METADATA = ("oiio:", "ICCProfile", "Orientation", "thumbnail", "hdrgm:", "Item:", "Container:", "rdf:",
                   "tiff:", "jpeg:", "png:", "openexr:", "hdr:", "planarconfig", "Exif:PixelXDimension",
                   "Exif:PixelYDimension")
_OF_ONE_FORMAT = ("compression", "chromaticities")
#: Diagonal of the 36 x 24 mm frame that 35 mm equivalents refer to [mm] (CIPA DCG-001).
_FULL_FRAME_DIAGONAL = 43.267


@dataclass(frozen=True, eq=False)
class Photograph:
    """A photograph, upright, with all that is needed to write a changed version in the same kind.

    radiance: (H, W, 3) float32, linear scene-referred Rec.709, 1 = photo white for integer files;
    straight (not multiplied by alpha). Negative where a colour lies outside Rec.709.
    alpha: (H, W) float32, 1 = opaque, or None.
    clipped: (H, W) bool, a channel at the top code value; in float files a channel not finite, whose
    pixel then has radiance 0.
    codes: (H, W, n) the file's own values, colour (1 or 3 channels) and then alpha, if any.
    """

    path: Path
    radiance: np.ndarray
    alpha: np.ndarray | None
    clipped: np.ndarray
    codes: np.ndarray = field(repr=False)
    format: str
    sample_type: str
    encoding: Encoding = field(repr=False)
    header: oiio.ImageSpec = field(repr=False)

    @property
    def width(self) -> int:
        return self.radiance.shape[1]

    @property
    def height(self) -> int:
        return self.radiance.shape[0]

    @property
    def is_grey(self) -> bool:
        return self.codes.shape[2] <= 2

    @property
    def is_float(self) -> bool:
        return self.codes.dtype.kind == "f"

    @property
    def suffix(self) -> str:
        """The usual file suffix of this kind, for example ".jpg"."""
        return _SUFFIXES[self.format][0]

    @property
    def has_associated_alpha(self) -> bool:
        """Whether the file's colours are multiplied by its alpha (OpenEXR's convention)."""
        return self.alpha is not None and not self.header.get_int_attribute("oiio:UnassociatedAlpha", 0)


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
        raise InputError(f"not a readable image ({_first_line(oiio.geterror())})",
                         remedy="give a JPEG, PNG, TIFF, EXR or HDR file")
    return source


def _read(source: oiio.ImageInput, path: Path, colour_space: str, max_pixels: int) -> Photograph:
    spec, format = source.spec(), source.format_name()
    if format not in _SUFFIXES:
        raise InputError(f"a {format} image", remedy="convert it to JPEG, PNG, TIFF, EXR or HDR")
    pixels = max(spec.width * spec.height, spec.full_width * spec.full_height)
    if pixels > max_pixels:
        raise InputError(f"{spec.width} x {spec.height} = {pixels / 1e6:.1f} megapixels exceed the limit of "
                         f"{max_pixels / 1e6:g}",
                         remedy="raise the photograph's max_megapixels or make it smaller")
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
        codes = _in_display_window(codes, spec)
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
    result = Photograph(radiance=encoding.decode(valid), alpha=alpha, clipped=~finite, **photograph)
    if result.has_associated_alpha:
        np.divide(result.radiance, alpha[..., None], out=result.radiance, where=alpha[..., None] > 0)
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
    message = _first_line(source.geterror())
    if codes is not None and "extraneous bytes" in message:  # harmless padding that some cameras write
        return
    raise InputError(f"truncated or damaged ({message})", remedy="copy the photograph again")


def _in_display_window(codes: np.ndarray, spec: oiio.ImageSpec) -> np.ndarray:
    """An EXR's pixels on its display window: overscan cut off, missing borders 0."""
    if (spec.x, spec.y, spec.width, spec.height) == (
            spec.full_x, spec.full_y, spec.full_width, spec.full_height):
        return codes
    canvas = np.zeros((spec.full_height, spec.full_width, codes.shape[2]), codes.dtype)
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    left, top = max(x, 0), max(y, 0)
    right, bottom = min(x + spec.width, spec.full_width), min(y + spec.height, spec.full_height)
    if right > left and bottom > top:
        canvas[top:bottom, left:right] = codes[top - y:bottom - y, left - x:right - x]
    return canvas


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


def encode(radiance: np.ndarray, like: Photograph, encoding: Encoding | None = None,
           sample_type: str | None = None) -> np.ndarray:
    """Values to store for `radiance`, (H, W, 3): (H, W, n) in the kind of `like`, alpha last.

    n drops to 1 (or 2 with alpha) where the photograph is grey and the result still is. Integer
    values are clipped and rounded; those of an unchanged radiance are the photograph's own codes.
    """
    radiance = np.asarray(radiance, np.float32)
    if radiance.shape != like.radiance.shape:
        raise ValueError(f"radiance {radiance.shape} for a photograph {like.radiance.shape}")
    if not np.isfinite(radiance).all():
        count = np.count_nonzero(~np.isfinite(radiance))
        raise ValueError(f"radiance has {count} values that are not finite")
    sample_type = sample_type or like.sample_type
    channels = 1 if like.is_grey and _is_grey(radiance) else 3
    encoding = encoding or _fitting_encoding(like, channels)
    is_integer = sample_type.startswith("uint")
    dtype = np.dtype(sample_type if is_integer else np.float32)
    values = np.empty(radiance.shape[:2] + (channels + (like.alpha is not None),), dtype)
    rows = max(1, 2_000_000 // like.width)  # in bands: transfer functions need several temporary copies
    for top in range(0, like.height, rows):
        band = slice(top, top + rows)
        linear = radiance[band]
        if like.has_associated_alpha and not is_integer:
            linear = linear * np.where(like.alpha[band] > 0, like.alpha[band], 1)[..., None]
        encoded = encoding.encode(linear, channels)
        if is_integer:
            encoded = np.rint(np.clip(encoded, 0, 1) * np.iinfo(dtype).max)
        elif sample_type == "half":
            encoded = np.clip(encoded, -65504, 65504)  # the largest half: beyond it lies infinity
        elif like.format == "hdr":
            encoded = np.maximum(encoded, 0)  # shared-exponent pixels have no sign
        values[band, :, :channels] = encoded
    if like.alpha is not None:
        if like.codes.dtype == dtype:
            values[..., -1] = like.codes[..., -1]
        else:
            values[..., -1] = np.rint(like.alpha * np.iinfo(dtype).max)
    return values


def _is_grey(radiance: np.ndarray) -> bool:
    """Whether no channel differs visibly (1e-3 of the value is a quarter of an 8-bit step)."""
    return all(np.allclose(radiance[..., 0], radiance[..., other], rtol=1e-3, atol=1e-5) for other in (1, 2))


def _fitting_encoding(like: Photograph, channels: int) -> Encoding:
    """The photograph's encoding, or sRGB where coloured fog meets a grey colour profile."""
    if channels == 3 and getattr(like.encoding, "colour_model", "rgb") == "gray":
        return SrgbEncoding()
    if channels == 3 and like.is_grey and isinstance(like.encoding, SrgbEncoding):
        return SrgbEncoding()
    return like.encoding


def write(path: str | os.PathLike, radiance: np.ndarray, like: Photograph) -> None:
    """Writes `radiance`, (H, W, 3) linear, in the kind of `like`; see `Photograph.suffix`.

    Alpha and metadata are the photograph's, pixels are upright. JPEG: quality 95 without chroma
    subsampling. Raises `InputError` if the file cannot be written; then nothing is left behind.
    """
    path = Path(path)
    if path.suffix.lower() not in _SUFFIXES[like.format]:
        raise ValueError(f"{path.name}: a {like.format} file is called {like.suffix}")
    values = encode(radiance, like)
    colours = values.shape[2] - (like.alpha is not None)
    encoding = _fitting_encoding(like, colours)
    _store(path, values, like, like.format, like.sample_type, encoding.profile)


def write_png(path: str | os.PathLike, radiance: np.ndarray, like: Photograph) -> None:
    """Writes the PNG that goes with every result: what a screen shows of `radiance`.

    8 bit for an 8-bit photograph, whose own noise hides the steps; 16 bit otherwise, since fog is
    smooth and 8 bits would show bands that the photograph never had. In the photograph's own
    colour profile if it has one, else sRGB; clipped at photo white, no tone mapping.
    """
    channels = 1 if like.is_grey and _is_grey(radiance) else 3
    encoding = _fitting_encoding(like, channels)
    if like.is_float or (encoding.profile is None and not isinstance(encoding, SrgbEncoding)):
        encoding = SrgbEncoding()
    sample_type = "uint8" if like.sample_type == "uint8" else "uint16"
    values = encode(radiance, like, encoding, sample_type)
    _store(Path(path), values, like, "png", sample_type, encoding.profile)


def write_unchanged(path: str | os.PathLike, photograph: Photograph) -> None:
    """Writes the photograph as it came: without fog nothing may change.

    In its own kind the file is copied byte for byte, its orientation tag included. As a PNG the
    upright code values are stored exactly; only a float photograph, which no PNG can hold, is
    encoded as by `write_png`.
    """
    path = Path(path)
    if path.suffix.lower() in _SUFFIXES[photograph.format]:
        with replacing(path) as partial:
            shutil.copyfile(photograph.path, partial)
    elif path.suffix.lower() != ".png":
        raise ValueError(f"{path.name}: neither {photograph.suffix} nor .png")
    elif photograph.is_float:
        write_png(path, photograph.radiance, photograph)
    else:
        _store(path, photograph.codes, photograph, "png", photograph.sample_type, photograph.encoding.profile)


def _store(path: Path, values: np.ndarray, like: Photograph, format: str, sample_type: str,
           profile: bytes | None) -> None:
    height, width, channels = values.shape
    spec = oiio.ImageSpec(width, height, channels, sample_type)
    names = ("R", "G", "B") if channels >= 3 else ("Y",)
    if like.alpha is not None:
        names, spec.alpha_channel = names + ("A",), channels - 1
    spec.channelnames = names
    for item in like.header.extra_attribs:
        if item.name.startswith(_STALE_METADATA) or (format != like.format and item.name in _OF_ONE_FORMAT):
            continue
        spec.attribute(item.name, item.type, item.value)
    spec.attribute("Orientation", 1)
    if like.alpha is not None and not (like.has_associated_alpha and format == like.format):
        spec.attribute("oiio:UnassociatedAlpha", 1)
    if profile:
        data_type = oiio.TypeDesc(f"uint8[{len(profile)}]")
        spec.attribute("ICCProfile", data_type, np.frombuffer(profile, np.uint8))
    if format == "jpeg":
        spec.attribute("compression", "jpeg:95")
        spec.attribute("jpeg:subsampling", "4:4:4")
    elif format == "tiff" and spec.get_string_attribute("compression") not in ("none", "lzw", "packbits"):
        spec.attribute("compression", "zip")  # never a lossy one

    with replacing(path) as partial:
        _reserve(partial, values.nbytes + 1_000_000)
        output = oiio.ImageOutput.create(format)
        succeeded = output.open(str(partial), spec) and output.write_image(np.ascontiguousarray(values))
        succeeded = output.close() and succeeded
        # The TIFF writer complains so about every file without EXIF data.
        errors = [line for line in output.geterror().splitlines()
                  if line.strip() and line != "failed TIFFWriteCustomDirectory() of the Exif data"]
        if not succeeded or errors:
            raise OSError(errors[0] if errors else f"the {format} writer failed")


def _reserve(path: Path, size: int) -> None:
    """Fails with `OSError` unless `size` bytes fit: on a full disk the JPEG encoder ends the process."""
    with open(path, "wb") as file:
        os.posix_fallocate(file.fileno(), 0, size)


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


def _first_line(message: str) -> str:
    return message.strip().splitlines()[0] if message.strip() else ""
