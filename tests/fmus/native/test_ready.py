"""FMUs for runs of our own: native where there is a compiler, kept, and readable where not."""

from ballscrew.fmus.catalogue import fmu
from ballscrew.fmus.native import ready
from ballscrew.fmus.native.ready import NATIVE, READABLE, ready_fmu


def test_a_native_fmu_is_made_once_and_a_readable_one_taken_where_nothing_compiles(
    native, monkeypatch, tmp_path
):
    made = ready_fmu("pid")
    assert made.build == NATIVE
    monkeypatch.setattr(ready, "compiler_for", lambda _: [])
    assert ready_fmu("pid") == made  # it is there already
    monkeypatch.setenv("BALLSCREW_CACHE", str(tmp_path))
    assert ready_fmu("pid").build == READABLE
    assert ready_fmu("pid").path == fmu("pid")
