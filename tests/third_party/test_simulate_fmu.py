"""The plant's FMU alone, driven by fmpy's simulate_fmu."""

import numpy as np
from scipy.integrate import solve_ivp
from wired_loop import HOSTS, OUTPUTS, ask

from ballscrew.fmus.catalogue import fmu_kernel
from ballscrew.solver.kernel import Model

STEP = 2e-3
VOLTS = {0.0: 20.0, 0.1: -30.0, 0.3: 12.0, 0.4: 0.0}  # by the time they begin
STOP = 0.5


def test_simulate_fmu_drives_the_plant_alone(fmus):
    """Forth, back and to a halt; scipy's Radau on the same equations is the other road."""
    ends = [*list(VOLTS)[1:], STOP]
    job = {
        "fmu": str(fmus["plant"]),
        "series": {
            "time": [t for pair in zip(VOLTS, ends, strict=True) for t in pair],
            "u": [u for u in VOLTS.values() for _ in range(2)],
        },
        "step": STEP,
        "stop": STOP,
        "outputs": list(OUTPUTS),
    }
    course = ask(HOSTS / "simulate_fmu_host.py", job)
    times = np.arange(round(STOP / STEP) + 1) * STEP
    np.testing.assert_allclose(course["time"], times, atol=1e-12)
    exact = integrated(times, ends)
    assert exact["v"].max() > 0.05
    assert exact["v"].min() < -0.05
    for name in OUTPUTS:
        off = np.abs(np.array(course[name]) - exact[name]).max()
        assert off < 1e-8 * np.ptp(exact[name]), name


def integrated(times, ends):
    """Outputs of the plant at these times."""
    model = Model(fmu_kernel("plant"))
    x = model.x.copy()
    rows = [model.outputs(0.0, x)]
    for (start, u), end in zip(VOLTS.items(), ends, strict=True):
        model.set_input("u", u)
        done = solve_ivp(
            model.derivatives,
            (start, end),
            x,
            method="Radau",
            jac=model.jacobian,
            t_eval=times[(times > start + STEP / 2) & (times < end + STEP / 2)].clip(max=end),
            rtol=1e-10,
            atol=[1e-12 * s.nominal for s in fmu_kernel("plant").states],
        )
        assert done.success
        rows += [model.outputs(t, y) for t, y in zip(done.t, done.y.T, strict=True)]
        x = done.y[:, -1]
    return {name: np.array([row[name] for row in rows]) for name in OUTPUTS}
