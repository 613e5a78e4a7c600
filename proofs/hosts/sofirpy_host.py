"""sofirpy: FMUs that step and then exchange."""

from pathlib import Path

from host import GOAL, answer, first_outputs
from sofirpy import simulate


def run(job):
    """Run; nothing is exchanged before the first step, so set the plant's first commands."""
    shown, last = (list(job["fmus"])[k] for k in (0, -1))
    starts = {last: {"x_d": GOAL}}
    if job["connections"]:
        first = first_outputs(job["fmus"][last])
        starts[shown] = {u: first[y] for (_, y), (_, u) in job["connections"] if y in first}
    wires = {name: [] for name in job["fmus"]}
    for (a, y), (b, u) in job["connections"]:
        end = {"connect_to_system": a, "connect_to_external_parameter": y}
        wires[b].append({"parameter_name": u, **end})
    table = simulate(
        stop_time=job["stop"],
        step_size=job["step"],
        fmu_paths={n: Path(f) for n, f in job["fmus"].items()},
        connections_config=wires if job["connections"] else None,
        start_values=starts,
        parameters_to_log={shown: ["x"]},
    )
    return table["time"], table[f"{shown}.x"]


answer(run)
