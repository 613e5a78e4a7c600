"""The axis with LuGre friction, typed from the thesis and solved by SciPy."""

import numpy as np
from scipy.integrate import solve_ivp

SCREW = 2 * np.pi * 1000  # rad/m
BACK_EMF = 60 / (255 * 2 * np.pi)  # V s/rad


def axis_under(volts, times):
    """Position, velocity, bristles, current and friction from rest; shape (times, 5)."""

    def friction(v, z):
        sign = 2 / np.pi * np.arctan(1e8 * v)
        steady = 1.284 + (2.35 - 1.284) * np.exp(-((v / 1.13975e-3) ** 2))
        rate = sign**2 * v - 66967.231 * sign * v * z / steady
        return 66967.231 * z + 344.56 * rate + 173 * v, rate

    def right(_, y):
        _, v, z, i = y
        force, rate = friction(v, z)
        current = (volts - 21.4 * i - BACK_EMF * SCREW * v) / 0.953e-3
        return [v, 37.4e-3 * SCREW * i - force, rate, current]

    start = np.zeros(4)
    done = solve_ivp(right, (0, times[-1]), start, "Radau", times, rtol=1e-11, atol=1e-15)
    x, v, z, i = done.y
    return np.column_stack([x, v, z, i, friction(v, z)[0]])
