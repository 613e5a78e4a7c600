"""Kernels on disk: kept under the sources that their equations come from, and no others."""

import json

import pytest
from prescribed_motion import prescribed_motion

from ballscrew.plant.lugre import lugre
from ballscrew.solver import kernel_cache, stored


def test_what_a_component_is_made_of_is_found_by_its_imports():
    sources = stored.sources_of("ballscrew.plant.lugre")
    assert {"ballscrew.plant.lugre", "ballscrew.plant.law", "ballscrew.solver.component"} <= set(
        sources
    )
    assert "ballscrew.controllers.nctf" not in sources
    assert all(f.is_file() for f in sources.values())


def test_components_that_a_list_names_are_found_too():
    assert "ballscrew.plant.dahl" in stored.sources_of("ballscrew.plant.law")


def test_a_changed_source_of_the_equations_changes_the_hash_and_another_does_not(monkeypatch):
    names = "plant.axis", "instruments.encoder"
    before = {m: stored.fingerprint(f"ballscrew.{m}") for m in names}
    stored.fingerprint.cache_clear()
    read = type(stored._TOP).read_bytes

    def changed(path):
        return read(path) + b"#" * (path.name == "ball_screw.py")

    monkeypatch.setattr(type(stored._TOP), "read_bytes", changed)
    after = {m: stored.fingerprint(f"ballscrew.{m}") for m in before}
    stored.fingerprint.cache_clear()
    assert after["plant.axis"] != before["plant.axis"]
    assert after["instruments.encoder"] == before["instruments.encoder"]


@pytest.mark.parametrize("damage", ["", "{", json.dumps({"name": "x"})])
def test_half_a_file_in_the_cache_is_made_again(tmp_path, monkeypatch, damage):
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path))

    def make():
        return prescribed_motion(lugre, "motion")

    first = stored.stored_kernel("motion", make, "ballscrew.plant.lugre")
    (file,) = (kernel_cache.folder() / "components").glob("motion-*.json")
    file.write_text(damage, encoding="utf-8")
    assert (
        stored.stored_kernel("motion", make, "ballscrew.plant.lugre").to_json() == first.to_json()
    )
