"""POV-Ray's log: warnings and errors found whatever its line breaks fell on, and failures told apart."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.imaging.maps import read_map
from pipeline.rendering import povray, povray_log

SPOILED = ("#version 3.7;\nglobal_settings { assumed_gamma 1 }\n// ---- templates/head.inc\n"
           '#warning "look at this"\n\nsphere { 0, 1 } }\n')


@pytest.mark.parametrize("length", [1, 30, 44, 52, 57, 70, 110], ids=lambda n: f"path of {n} more")
def test_error_after_a_warning_in_a_long_path(length, tmp_path):
    """The real program, which breaks lines at 80 characters, in the middle of a path too."""
    pov = tmp_path / ("d" * length) / "t.pov"
    pov.parent.mkdir()
    pov.write_text(SPOILED)
    with pytest.raises(InputError) as refused:
        povray.render(pov, tmp_path / "t.exr", 4, 4)
    assert refused.value.place == "templates/head.inc"
    assert refused.value.problem == f"POV-Ray: Expected 'object or directive', }} found instead ({pov}:6)"
    assert povray.warnings_beside(tmp_path / "t.exr", pov) == ["templates/head.inc: POV-Ray: look at this"]


def test_warning_after_the_render_has_its_place_above(tmp_path):
    pov = tmp_path / "a.pov"
    pov.write_text("sphere {\n0, 1 }\n")
    log = ("Rendered 48 of 48 pixels (100%)\nFile: /x/a.pov  Line: 2\nShutdown Warning: The maximum gradient found was"
           " 2.161, but max_gradient of the\n isosurface was set to 1.000. Adjust\n max_gradient.\n----\n")
    assert povray_log.warnings(log, pov) == [
        f"{pov}:2: POV-Ray: The maximum gradient found was 2.161, but max_gradient of the isosurface was set to"
        " 1.000. Adjust max_gradient."]


def test_harmless_warnings_are_left_out_by_name(tmp_path):
    log = "File 'a.pov' line 2: Parse Warning: Should have at least 2 objects in csg.\n"
    assert len(povray_log.messages(log)) == 1 and povray_log.warnings(log, tmp_path / "a.pov") == []


def test_warnings_without_number_are_counted(tmp_path):
    pov = tmp_path / "a.pov"
    log = "".join(f"File 'a.pov' line 1: Parse Warning: turn {n}\n" for n in range(1000))
    told = povray_log.warnings(log, pov)
    assert len(told) == 21 and told[-1] == "a.pov: 980 more warnings of POV-Ray are in its log"


@pytest.mark.parametrize("status, log, says", [
    (255, "", "POV-Ray failed: it said nothing; see "),
    (3, "  ouch  \n", "POV-Ray failed: ouch; see "),
    (137, "", "POV-Ray was ended by signal SIGKILL; run again"),
    (-11, "", "signal SIGSEGV; a crash at the very end is a known fault of function densities"),
    (134, "terminate called\n  what():  Cannot access data in file.\nAborted\n", "no space left; free some space"),
    (153, "==== [Rendering...]\n", "no space left; free some space"),
    (1, "File 'a.pov' line\n 1: Parse Error: std::bad_alloc\n", "POV-Ray ran out of memory on a.pov; lower"),
    (0, "\npovray: received signal SIGTERM: Termination; requested render cancel\n", "POV-Ray was told to stop; run again"),
    (2, "Fatal error in parser: Frontend halted render.\nRender cancelled by user\n", "POV-Ray was told to stop; run again"),
    (1, "\033[31mFatal error\007\n", "POV-Ray failed: [31mFatal error; see "),
], ids=["no signal's number", "last words", "killed", "crash", "full disk", "file size", "memory", "stopped late", "stopped",
        "terminal codes"])
def test_failures_are_told_apart(status, log, says, tmp_path):
    pov = tmp_path / "a.pov"
    pov.write_text("\n")
    said = str(povray_log.failure(log, pov, tmp_path / "a.log", status))
    assert says in said and said.isprintable()


@pytest.mark.parametrize("spoil", [lambda data: data[:-40], lambda data: b""], ids=["cut", "empty"])
def test_picture_that_was_cut_since_is_rendered_again(spoil, tmp_path):
    """As where the machine went down before the disk held it."""
    pov, image = tmp_path / "a.pov", tmp_path / "a.exr"
    pov.write_text("#version 3.7;\nglobal_settings { assumed_gamma 1 }\ncamera { location -z look_at 0 }\n"
                   "sphere { 0, 0.5 pigment { rgb 1 } finish { emission 0.7 } }\n")
    assert povray.render(pov, image, 8, 6) > 0
    good = read_map(image)
    assert povray.render(pov, image, 8, 6) == 0 and good.max() > 0.5
    image.write_bytes(spoil(image.read_bytes()))
    assert povray.render(pov, image, 8, 6) > 0
    assert np.array_equal(read_map(image), good)
