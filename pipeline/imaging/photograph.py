"""Photographs in and out: files on one side, upright linear radiance on the other.

Reading gives linear, scene-referred Rec.709 radiance, 1 = photo white, pixels upright (the EXIF
orientation applied): annotations refer to these pixels. Writing takes a radiance of the same size
back into the kind of file that it came from: format, bit depth, colour profile, alpha, metadata.

Kinds: JPEG (8 bit), PNG and TIFF (8 and 16 bit, TIFF also float), OpenEXR, Radiance HDR.
"""

from pipeline.imaging.photograph_file import Photograph
from pipeline.imaging.photograph_reading import MAX_PIXELS, read, read_exif_focal_length
from pipeline.imaging.photograph_resampling import averaged, resampled, working_size
from pipeline.imaging.photograph_writing import encode, write, write_png, write_unchanged, write_with_png

__all__ = ["MAX_PIXELS", "Photograph", "averaged", "encode", "read", "read_exif_focal_length", "resampled",
           "working_size", "write", "write_png", "write_unchanged", "write_with_png"]
