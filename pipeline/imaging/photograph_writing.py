"""Radiance back into the kind of file that a photograph came from, and into the PNG beside it."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from pipeline.imaging.atomic import replacing
from pipeline.imaging.colour import Encoding, SrgbEncoding
from pipeline.imaging.maps import Metadata, set_attribute
from pipeline.imaging.photograph_file import SUFFIXES, Photograph
from pipeline.side_by_side import side_by_side

#: Metadata about pixels as they were stored: false or superfluous beside new pixels. The gain map of
#: an Ultra-HDR photograph (hdrgm and its container) would brighten the fog by the clear picture's lights.
_STALE_METADATA = ("oiio:", "ICCProfile", "Orientation", "thumbnail", "hdrgm:", "Item:", "Container:", "rdf:",
                   "tiff:", "jpeg:", "png:", "openexr:", "hdr:", "planarconfig", "Exif:PixelXDimension",
                   "Exif:PixelYDimension")
#: Larger photographs are compressed fast [pixel].
LARGE = 4_000_000
_OF_ONE_FORMAT = ("compression", "chromaticities")


def write(path: str | os.PathLike, radiance: np.ndarray, like: Photograph,
          metadata: Metadata = {}) -> None:
    """Writes `radiance`, (H, W, 3) linear, in the kind of `like`; see `Photograph.suffix`.

    Alpha and metadata are the photograph's, pixels are upright. JPEG: quality 95 without chroma
    subsampling. An EXR carries `metadata` as well. Raises `InputError` if the file cannot be written; then
    nothing is left behind.
    """
    _write(Path(path), radiance, like, metadata)


def write_with_png(path: str | os.PathLike, png: str | os.PathLike, radiance: np.ndarray, like: Photograph,
                   metadata: Metadata = {}, finished: Callable[[], None] | None = None) -> None:
    """As `write` and, after that, `write_png`; what both store alike is encoded once.

    finished: called between the two; what it raises leaves the PNG as it was.
    """
    values = _write(Path(path), radiance, like, metadata)
    if finished:
        finished()
    channels = values.shape[2] - (like.alpha is not None)
    encoding, sample_type = _for_screen(like, channels)
    if sample_type == like.sample_type and encoding is _fitting_encoding(like, channels):
        _store(Path(png), values, like, "png", sample_type, encoding.profile)
    else:
        write_png(png, radiance, like)


def _write(path: Path, radiance: np.ndarray, like: Photograph, metadata: Metadata) -> np.ndarray:
    if path.suffix.lower() not in SUFFIXES[like.format]:
        raise ValueError(f"{path.name}: a {like.format} file is called {like.suffix}")
    values = encode(radiance, like)
    colours = values.shape[2] - (like.alpha is not None)
    encoding = _fitting_encoding(like, colours)
    _store(path, values, like, like.format, like.sample_type, encoding.profile, metadata)
    return values


def write_png(path: str | os.PathLike, radiance: np.ndarray, like: Photograph) -> None:
    """Writes the PNG that goes with every result: what a screen shows of `radiance`.

    8 bit for an 8-bit photograph, whose own noise hides the steps; 16 bit otherwise, since fog is
    smooth and 8 bits would show bands that the photograph never had. In the photograph's own
    colour profile if it has one, else sRGB; clipped at photo white, no tone mapping.
    """
    encoding, sample_type = _for_screen(like, 1 if like.is_grey and _is_grey(radiance) else 3)
    values = encode(radiance, like, encoding, sample_type)
    _store(Path(path), values, like, "png", sample_type, encoding.profile)


def _for_screen(like: Photograph, channels: int) -> tuple[Encoding, str]:
    """Encoding and sample type of `write_png`."""
    encoding = _fitting_encoding(like, channels)
    if like.is_float or (encoding.profile is None and not isinstance(encoding, SrgbEncoding)):
        encoding = SrgbEncoding()
    return encoding, "uint8" if like.sample_type == "uint8" else "uint16"


def write_unchanged(path: str | os.PathLike, photograph: Photograph) -> None:
    """Writes the photograph as it came: without fog nothing may change.

    In its own kind the file is copied byte for byte, its orientation tag included. As a PNG the
    upright code values are stored exactly; only a float photograph, which no PNG can hold, is
    encoded as by `write_png`. A resampled one is written as any other result.
    """
    path = Path(path)
    if photograph.resampled:
        write_png(path, photograph.radiance, photograph) if path.suffix.lower() == ".png" else write(
            path, photograph.radiance, photograph)
    elif path.suffix.lower() in SUFFIXES[photograph.format]:
        with replacing(path) as partial:
            shutil.copyfile(photograph.path, partial)
    elif path.suffix.lower() != ".png":
        raise ValueError(f"{path.name}: neither {photograph.suffix} nor .png")
    elif photograph.is_float:
        write_png(path, photograph.radiance, photograph)
    else:
        _store(path, photograph.codes, photograph, "png", photograph.sample_type, photograph.encoding.profile)


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

    def add(band: slice) -> None:
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

    rows = max(1, 1_000_000 // like.width)  # in bands: transfer functions need several temporary copies
    for _ in side_by_side(add, [slice(top, top + rows) for top in range(0, like.height, rows)]):
        pass
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


def _store(path: Path, values: np.ndarray, like: Photograph, format: str, sample_type: str,
           profile: bytes | None, metadata: Metadata = {}) -> None:
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
    if width * height > LARGE:
        # PNG in a third of the time, for files a third larger
        if format == "png":
            spec.attribute("png:compressionLevel", 1)
        elif format == "openexr" and spec.get_string_attribute("compression", "zip") == "zip":
            spec.attribute("compression", "zip:1")
    if format == "openexr" and not spec.get_string_attribute("DateTime"):
        spec.attribute("DateTime", "1970:01:01 00:00:00")  # else the time of day: no two builds alike

    for name, value in metadata.items() if format == "openexr" else ():
        set_attribute(spec, name, value)

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
