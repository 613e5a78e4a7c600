"""Maps: what is in a cell, borders, chunks that survive a kill, and the picture's boundary."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from scipy.integrate import solve_ivp

from ballscrew.orchestration.fmu.limits import TOLERANCE_OF_MOTIONS
from ballscrew.orchestration.loop.loop import Loop
from ballscrew.orchestration.study.workers import Processes
from ballscrew.stability import stability_map
from ballscrew.stability.attractor import Kind
from ballscrew.stability.map_plan import MapPlan, model_at, read_axis, run_cell, stuck_growth
from ballscrew.stability.stability_map import make_map

SIGMA0, SIGMA1 = 66967.231, 344.56


def gamma(columns=5, rows=4, stop=20.0, **options):
    """A coarse map of the estimates of an input-output linearization (Fig. 3.18)."""
    x = read_axis(f"sigma0_hat=66965.89:66969.24:{columns}", Loop("iol"))
    y = read_axis(f"sigma1_hat=340:366:{rows}", Loop("iol"))
    return MapPlan(Loop("iol", stop=stop), x, y, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("map")
    return folder, make_map(gamma(), folder, Processes(1))


@pytest.mark.parametrize("tolerance", [1e-8, 1e-6])
def test_cells_know_what_becomes_of_a_loop(tolerance):
    study = gamma()
    cycle = run_cell(study, SIGMA0, 342.5, tolerance)
    stuck = run_cell(study, 66966.331, 349.41, tolerance)
    away = run_cell(study, 66969.2, 350.0, tolerance)
    assert cycle.verdict is Kind.CYCLE
    assert cycle.oscillation == pytest.approx(2.9e-4, rel=0.05)  # half of 0.58 mm
    assert stuck.verdict is Kind.LINE
    assert stuck.final_error == pytest.approx(-23.4e-6, rel=0.01)  # shared with four other solvers
    assert away.verdict is Kind.DIVERGES
    assert np.isnan(away.final_error)


def test_the_table_has_a_row_for_every_cell_in_order_and_counts_agree(whole):
    folder, summary = whole
    table = pq.read_table(folder / "map.parquet")
    names = "sigma0_hat sigma1_hat verdict final_error lambda1_bits_per_s oscillation_amplitude "
    assert table.column_names == [*names.split(), "reason", "checked"]
    rows = table.to_pylist()
    assert len(rows) == 20
    assert [(r["sigma1_hat"], r["sigma0_hat"]) for r in rows] == sorted(
        (r["sigma1_hat"], r["sigma0_hat"]) for r in rows
    )
    for verdict, count in summary.verdicts.items():
        assert sum(r["verdict"] == verdict for r in rows) == count
    assert {"limit cycle", "diverges", "stuck on a line of equilibria"} <= set(summary.verdicts)
    figures = json.loads((folder / "map.json").read_text())
    assert figures["checked_tighter"] == sum(r["checked"] for r in rows) > 0
    assert (folder / "map.png").read_bytes()[:4] == b"\x89PNG"
    assert not (folder / "map.parts").exists()


@pytest.mark.prove
def test_a_loop_that_rests_late_is_followed_on_until_it_does_where_another_solver_ends(tmp_path):
    """From other starts an NCTF loop sticks after 26 to 111 s; the runs take 5 s."""
    x = read_axis("plant.x_start=-0.2:0.2:3", Loop("nctf"))
    y = read_axis("plant.v_start=-0.1:0.1:2", Loop("nctf"))
    study = MapPlan(Loop("nctf", stop=5.0), x, y, tolerance=1e-6)
    summary = make_map(study, tmp_path, Processes(1))
    assert summary.verdicts == {Kind.LINE: 6}
    assert summary.undecided == {}
    model = model_at(study, *study.point(5), 1e-6)
    nominal = model.kernel.nominal
    end = solve_ivp(
        lambda t, scaled: model.derivatives(t, scaled * nominal) / nominal,
        (0.0, 100.0),
        model.x / nominal,
        "Radau",
        t_eval=[60.0, 80.0, 100.0],
        jac=lambda t, scaled: model.jacobian(t, scaled * nominal) * nominal / nominal[:, None],
        rtol=1e-6,
        atol=1e-9,
    )
    assert end.success
    assert np.ptp(end.y, axis=1).max() < 1e-6  # nominal magnitudes: there is no motion any more
    assert end.y[0, -1] * nominal[0] == pytest.approx(study.loop.set_point, abs=1e-6)


@pytest.mark.ci
def test_a_sampled_loop_is_followed_on_until_it_rests():
    x = read_axis("plant.x_start=-0.2:0.2:2", Loop("pid_sampled"))
    y = read_axis("plant.v_start=-0.1:0.1:2", Loop("pid_sampled"))
    study = MapPlan(Loop("pid_sampled", stop=5.0), x, y, tolerance=1e-6)
    assert run_cell(study, -0.2, 0.1, 1e-6).verdict is Kind.LINE


@pytest.mark.ci
def test_a_cell_without_a_controller_says_so():
    x = read_axis("design.m=8:1e4:2", Loop("nctf"))
    y = read_axis("plant.sigma2=1:2:2", Loop("nctf"))
    found = run_cell(MapPlan(Loop("nctf", stop=1.0), x, y), 1e4, 1.0, 1e-6)
    assert found.verdict is Kind.UNDECIDED
    assert found.reason.startswith("no controller can be designed for this plant: ")


@pytest.mark.ci
@pytest.mark.parametrize(
    ("first", "again", "verdict", "reason"),
    [
        (Kind.LINE, Kind.LINE, Kind.LINE, ""),
        (Kind.LINE, Kind.CREEPING, Kind.CREEPING, ""),
        (Kind.CREEPING, Kind.LINE, Kind.CREEPING, ""),
        (
            Kind.CYCLE,
            Kind.LINE,
            Kind.UNDECIDED,
            "a tenth of the tolerance changes the verdict: limit cycle, then stuck on a line of "
            "equilibria",
        ),
    ],
)
def test_what_two_tolerances_say_becomes_one_verdict(
    tmp_path, monkeypatch, first, again, verdict, reason
):
    def chunk(study, cells, share):
        kind = first if share == 1.0 else again
        row = {"cell": list(cells), "x": [0.0] * len(cells), "verdict": [kind] * len(cells)}
        return row | {"reason": [""] * len(cells)}

    monkeypatch.setattr(stability_map, "run_chunk", chunk)
    summary = make_map(gamma(), tmp_path, Processes(1))
    rows = [r for r in pq.read_table(tmp_path / "map.parquet").to_pylist() if r["checked"]]
    assert {(r["verdict"], r["reason"]) for r in rows} == {(verdict, reason)}
    assert sum(summary.undecided.values()) == summary.disagreed == bool(reason) * len(rows)


def test_the_stuck_regime_s_boundary_is_that_of_the_cubic():
    study = gamma()
    for d0, d1 in ((-1.0, 2.0), (0.5, 17.5), (0.5, 18.5), (1.0, -0.3), (1.5, 0.5), (-0.5, -3.0)):
        cubic = [1.0, 18 - d1, 107 - d0 + (499.56 + d1) * d1, 210 + (499.56 + d1) * d0]
        expected = np.roots(cubic).real.max()
        found = stuck_growth(study, SIGMA0 + d0, SIGMA1 + d1)
        assert found == pytest.approx(expected, rel=2e-3, abs=2e-3)


@pytest.mark.ci
def test_nctf_is_designed_on_the_perturbed_plant_and_run_on_the_nominal_one():
    x = read_axis("design.sigma1=241:448:3", Loop("nctf"))
    y = read_axis("plant.Fc=1.2:1.4:2", Loop("nctf"))
    study = MapPlan(Loop("nctf"), x, y, exponents=True)
    nominal = run_cell(study, SIGMA1, 1.284, 1e-8)
    soft = run_cell(study, 0.7 * SIGMA1, 1.284, 1e-8)
    # Table 3.3 at 300 s and 100 % / 70 %: -0.0134 and -0.0167; neutral, so lambda * t is constant
    assert nominal.lambda1 * 20.0 == pytest.approx(-0.0134 * 300, rel=0.02)
    assert soft.lambda1 * 20.0 == pytest.approx(-0.0167 * 300, rel=0.03)
    assert nominal.verdict is Kind.LINE


@pytest.mark.ci
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_a_motion_that_stops_to_return_after_hundreds_of_returns_is_followed_on_to_rest() -> None:
    cell = run_cell(gamma(), 66968.80774193548, 362.1406451612903, TOLERANCE_OF_MOTIONS)
    assert cell.verdict is not Kind.UNDECIDED
