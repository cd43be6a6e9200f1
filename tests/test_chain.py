"""Stages in one process: what runs beside POV-Ray, and what a make leaves out because it was done already."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest

from pipeline import chain
from pipeline.imaging.maps import read_map
from pipeline.paths import PROJECT
from tests.conftest import CHAIN

#: numpy's threads at work while POV-Ray is started, over and over: with a fork each waits for the other for ever.
STARTING = """
import threading
from pathlib import Path
import numpy as np
from pipeline.rendering import povray
one, other = np.ones((3, 3)), np.ones((3, 40000))
def multiply():
    while True:
        one @ other
def start():
    for _ in range(40):
        povray._run(["true"], Path("."), Path("x.pov"), Path("x.exr"), 30.0)
threading.Thread(target=multiply, daemon=True).start()
starting = [threading.Thread(target=start, daemon=True) for _ in range(6)]
[thread.start() for thread in starting]
[thread.join() for thread in starting]
print("all ended")
"""


def test_renders_start_while_numpy_is_at_work(tmp_path):
    environment = {key: value for key, value in os.environ.items() if key not in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    done = subprocess.run([sys.executable, "-c", STARTING], cwd=tmp_path, env={**environment, "PYTHONPATH": str(PROJECT)},
                          capture_output=True, text=True, timeout=120)
    assert done.stdout.strip() == "all ended", done.stderr


def test_what_is_worked_out_beforehand_is_the_same(tiny_scene):
    tiny_scene.replace("shapes:\n", "shapes:\n  box: {type: cuboid, centre: [0.3, 0.4, -3], size: [0.6, 0.8, 0.5], yaw: 20}\n")
    assert tiny_scene.run(*CHAIN[:CHAIN.index("emit")]) == 0
    build = tiny_scene.build
    maps = build.transmittance, build.in_scattering(), build.in_scattering("lamp")
    plan = json.loads(build.plan.read_text())
    assert any(one["id"] == "shadows_lamp" for one in plan["runs"]) and plan["check"], "something is rendered and checked"
    names, results, errors = ("emit", "render", "decompose"), [], []
    for part in (names[:2] + names[2:], *((name,) for name in names)):
        chain.run(build, part, done=lambda name, seconds: None)
        if part[-1] == "decompose":
            results.append([read_map(path) for path in maps])
            errors.append(json.loads(build.maps.read_text())["estimated_error"])
    for together, apart in zip(*results):
        np.testing.assert_array_equal(together, apart)
    assert errors[0] == errors[1]


def test_what_fails_beside_a_render_stops_the_stage_that_wants_it(tiny_scene, monkeypatch):
    assert tiny_scene.run(*CHAIN[:CHAIN.index("render")]) == 0
    from pipeline.stages import decompose

    def fails(build):
        raise ValueError("worked out beforehand")

    monkeypatch.setattr(decompose, "beforehand", fails)
    finished = []
    with pytest.raises(ValueError, match="worked out beforehand"):
        chain.run(tiny_scene.build, ("render", "decompose"), done=lambda name, seconds: finished.append(name))
    assert finished == ["render"]


def test_stages_are_held_one_at_a_time(tiny_scene):
    held = []

    @contextmanager
    def holding(name):
        held.append(name)
        yield
        held.append(f"/{name}")

    assert tiny_scene.run(*CHAIN[:CHAIN.index("plan")]) == 0
    chain.run(tiny_scene.build, ("plan", "emit"), done=lambda name, seconds: None, started=holding)
    assert held == ["plan", "/plan", "emit", "/emit"]
