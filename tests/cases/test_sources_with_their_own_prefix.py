"""Sources that put their model's name before FMI's are compiled and called."""

import pytest
from cases import cart_position, case

from ballscrew.orchestration.loop import Loop
from ballscrew.orchestration.reference_signal import Reference
from ballscrew.orchestration.run import run_closed_loop


def test_sources_that_define_the_prefix_themselves(tmp_path):
    folder = case("sources_with_their_own_prefix", tmp_path)
    names = str(folder / "pd.fmu"), str(folder / "cart_src.fmu")
    run = run_closed_loop(Loop(*names, Reference.constant(0.1), stop=0.5, step=1e-3)).run
    assert run.verdict.trusted
    assert run.outputs["x"][-1] == pytest.approx(cart_position(0.5), rel=1e-3)
