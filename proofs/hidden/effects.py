"""The physics of a hidden effect: a ball screw typed by hand, with one thing or two that no
believed model has.

Nothing here comes from the project's plant or stepper: fourth-order Runge-Kutta at 20 us, two
masses where the screw and the block may part, friction noise, an encoder on the motor's side. The
same friction along a given motion, for what an effect amounts to in newtons, is here as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLE = 1e-3  # s
SUBSTEPS = 50
SAMPLES = 20_000
DURATION = SAMPLES * SAMPLE
COUNT = 1e-3 / 512  # m
CURRENT_NOISE = 1e-3  # A rms
NOISE_SHARE = 0.02  # of Fc, rms
NOISE_TIME = 0.01  # s
VOLTAGE_LIMIT = 36.0

NOMINAL = {
    "m": 1.0,
    "Jm": 4.2e-7,
    "kt": 37.4e-3,
    "ke": 60 / (255 * 2 * math.pi),
    "R": 21.4,
    "L": 0.953e-3,
    "p": 1000.0,
    "sigma0": 66967.231,
    "sigma1": 344.56,
    "sigma2": 173.0,
    "Fc": 1.284,
    "Fs": 2.35,
    "Vs": 1.13975e-3,
    "Kv": 1e8,
}

# Places in the array of numbers that the compiled code takes.
NAMES = (
    *("m", "rotor", "kt", "ke", "R", "L", "sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs", "p"),
    *("asymmetry", "periodic", "periodic_phase", "trend", "middle", "half_range"),
    *("ripple", "ripple_n", "ripple_phase", "load", "s3", "rise", "V2", "delay"),
    *("drift", "R_drift", "gap", "stiffness", "limit", "detent", "detent_place", "detent_width"),
    *("memory", "memory_length", "burst"),
)
PLACE = {name: k for k, name in enumerate(NAMES)}
# fmt: off
(M, JR, KT, KE, R, L, S0, S1, S2, FC, FS, VS, P,
 ASYM, PER, PER_PH, TREND, MID, HALF, RIP, RIP_N, RIP_PH, LOAD, S3, RISE, V2, DELAY,
 DRIFT, R_DRIFT, GAP, STIFF, LIMIT, DETENT, DET_X, DET_W, MEM, MEM_LEN, BURST) = range(len(NAMES))
# fmt: on

SPRING_RATIO = 0.1  # of critical, the block on the spring between screw and block
CONTACT_STIFFNESS, CONTACT_RATIO = 2e7, 0.5
REVERSED = 5e-6  # m; less of a way back is no reversal

OPEN, PID, NCTF, IOL = range(4)


def numbers(values: dict[str, float]) -> Array:
    """The numbers for the compiled code: the nominal axis, and `values` over it."""
    angle = 2 * math.pi * NOMINAL["p"]
    whole = {n: v for n, v in NOMINAL.items() if n in PLACE}
    whole |= {"kt": NOMINAL["kt"] * angle, "ke": NOMINAL["ke"] * angle}
    whole |= {"rotor": NOMINAL["Jm"] * angle**2, "half_range": 1.0, "V2": 5e-3}
    whole |= {"limit": 1e9, "detent_width": 1e-3, "memory_length": 1e-3} | values
    return np.array([whole.get(n, 0.0) for n in NAMES])


@njit(cache=True, error_model="numpy")
def _scales(q, x, v, t, way, burst):  # type: ignore[no-untyped-def]
    """What the Stribeck curve, and what the viscous share is multiplied by."""
    sign = 1.0 if v > 0 else (-1.0 if v < 0 else 0.0)
    both = (1.0 + q[ASYM] * sign) * (1.0 + q[DRIFT] * t / DURATION)
    curve = both * (1.0 + q[TREND] * (x - q[MID]) / q[HALF])
    if q[PER] != 0.0:
        curve *= 1.0 + q[PER] * math.cos(2 * math.pi * q[P] * x + q[PER_PH])
    if q[MEM] != 0.0:
        curve *= 1.0 + q[MEM] * math.exp(-way / q[MEM_LEN])
    return curve * (1.0 + q[BURST] * burst), both


@njit(cache=True, error_model="numpy")
def _stribeck(q, v):  # type: ignore[no-untyped-def]
    g = q[FC]
    if abs(v) < 6.0 * q[VS]:  # e^-36 is nothing to a double
        g += (q[FS] - q[FC]) * math.exp(-((v / q[VS]) ** 2))
    if q[RISE] != 0.0:
        g += q[RISE] * math.exp(-((v / q[V2]) ** 2))
    return g


@njit(cache=True, error_model="numpy")
def _other(q, x, v):  # type: ignore[no-untyped-def]
    """Forces against motion in +x that are no part of the law."""
    f = q[LOAD] + q[S3] * v * abs(v)
    if q[RIP] != 0.0:
        f += q[RIP] * math.cos(2 * math.pi * q[P] * q[RIP_N] * x + q[RIP_PH])
    if q[DETENT] != 0.0:
        s = (x - q[DET_X]) / q[DET_W]
        f += q[DETENT] * s * math.exp(0.5 - 0.5 * s * s)
    return f


@njit(cache=True, error_model="numpy")
def _friction(q, x, v, z, t, way, burst):  # type: ignore[no-untyped-def]
    """Force against motion in +x, and the bristle's rate."""
    curve, both = _scales(q, x, v, t, way, burst)
    rate = v - q[S0] * abs(v) * z / (_stribeck(q, v) * curve)
    force = q[S0] * z + q[S1] * rate + q[S2] * both * v
    return force + _other(q, x, v), rate


@njit(cache=True, error_model="numpy")
def _contact(q, stretch, speed):  # type: ignore[no-untyped-def]
    """Force of the screw on the block."""
    if q[STIFF] > 0.0:
        return q[STIFF] * stretch + 2 * SPRING_RATIO * math.sqrt(q[STIFF] * q[M]) * speed
    damping = 2 * CONTACT_RATIO * math.sqrt(CONTACT_STIFFNESS * q[M])
    half = 0.5 * q[GAP]
    if stretch > half:
        return max(CONTACT_STIFFNESS * (stretch - half) + damping * speed, 0.0)
    if stretch < -half:
        return min(CONTACT_STIFFNESS * (stretch + half) + damping * speed, 0.0)
    return 0.0


@njit(cache=True, error_model="numpy")
def _rates(q, y, u, t, noise, way, burst, out):  # type: ignore[no-untyped-def]
    """States: motor's side x, v; block's x, v; bristle; current."""
    f, rate = _friction(q, y[2], y[3], y[4], t, way, burst)
    f += noise
    drive = q[KT] * y[5]
    out[0] = y[1]
    if q[STIFF] > 0.0 or q[GAP] > 0.0:  # the motor and the block move apart
        c = _contact(q, y[0] - y[2], y[1] - y[3])
        out[1] = (drive - c) / q[JR]
        out[3] = (c - f) / q[M]
    else:
        out[1] = (drive - f) / (q[M] + q[JR])
        out[3] = out[1]
    out[2] = y[3]
    out[4] = rate
    out[5] = (u - q[R] * (1.0 + q[R_DRIFT] * t / DURATION) * y[5] - q[KE] * y[1]) / q[L]


@njit(cache=True, error_model="numpy")
def _command(kind, gains, q0, y, measured, last, reference, memory):  # type: ignore[no-untyped-def]
    """The controllers at a sample: `memory` is their integral."""
    error = reference - measured
    speed = (measured - last) / SAMPLE
    if kind == PID:
        memory += SAMPLE * error
        u = gains[0] * error + gains[1] * memory - gains[2] * speed
    elif kind == NCTF:
        followed = gains[0] * math.tanh(gains[1] * error) - speed
        u = gains[2] * followed + gains[3] * memory
        memory += SAMPLE * followed
    else:
        # Linearized with the current as a quick inner loop: what is held for a millisecond cannot
        # shape a current that settles in 45 us.
        f, _ = _friction(q0, y[2], y[3], y[4], 0.0, 0.0, 0.0)
        demand = gains[0] * (reference - y[0]) - gains[1] * y[1]
        u = q0[KE] * y[1] + q0[R] / q0[KT] * (f + (q0[M] + q0[JR]) * demand)
    return min(max(u, -VOLTAGE_LIMIT), VOLTAGE_LIMIT), memory


@njit(cache=True, error_model="numpy")
def _simulate(q, q0, kind, gains, given, noise, bursts, substeps):  # type: ignore[no-untyped-def]
    n = len(given) - 1
    states = np.zeros((n + 1, 6))
    way_of, command, applied = np.zeros(n + 1), np.zeros(n + 1), np.zeros(n)
    y, w = np.zeros(6), np.zeros(6)
    k1, k2, k3, k4 = np.zeros(6), np.zeros(6), np.zeros(6), np.zeros(6)
    h = SAMPLE / substeps
    memory, last = 0.0, 0.0
    direction, extreme, turned = 1.0, 0.0, -1.0
    whole = int(q[DELAY] / SAMPLE)
    late = q[DELAY] / SAMPLE - whole
    for k in range(n + 1):
        measured = math.floor(y[0] / COUNT) * COUNT
        if kind == OPEN:
            command[k] = given[k]
        else:
            command[k], memory = _command(kind, gains, q0, y, measured, last, given[k], memory)
            last = measured
        states[k] = y
        way_of[k] = abs(y[2] - turned)
        if k == n:
            break
        new = command[k - whole] if k >= whole else 0.0
        old = command[k - whole - 1] if k > whole else 0.0
        new = min(max(new, -q[LIMIT]), q[LIMIT])
        old = min(max(old, -q[LIMIT]), q[LIMIT])
        for j in range(substeps):
            t = (k + j / substeps) * SAMPLE
            share = min(max(late * substeps - j, 0.0), 1.0)  # of this step still the old voltage
            u = share * old + (1.0 - share) * new
            applied[k] += u / substeps
            burst = 0.0
            for b in range(len(bursts)):
                if bursts[b, 0] <= t < bursts[b, 1]:
                    burst = 1.0
            way = abs(y[2] - turned)
            slope = noise[k + 1] - noise[k]
            f0 = noise[k] + slope * j / substeps
            fh, f1 = f0 + 0.5 * slope / substeps, f0 + slope / substeps
            _rates(q, y, u, t, f0, way, burst, k1)
            w[:] = y + 0.5 * h * k1
            _rates(q, w, u, t + 0.5 * h, fh, way, burst, k2)
            w[:] = y + 0.5 * h * k2
            _rates(q, w, u, t + 0.5 * h, fh, way, burst, k3)
            w[:] = y + h * k3
            _rates(q, w, u, t + h, f1, way, burst, k4)
            y += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            if direction * (y[2] - extreme) > 0.0:
                extreme = y[2]
            elif direction * (extreme - y[2]) > REVERSED:
                turned, direction, extreme = extreme, -direction, y[2]
    return states, way_of, command, applied


@dataclass(frozen=True)
class Motion:
    """What happened, at the samples (``applied``: the mean over the millisecond after each)."""

    motor_position: Array
    motor_speed: Array
    position: Array
    speed: Array
    deflection: Array
    current: Array
    way: Array
    command: Array
    applied: Array

    @property
    def encoder(self) -> Array:
        """Position as counted on the motor's side [m]."""
        return np.asarray(np.floor(self.motor_position / COUNT) * COUNT)


def simulate(
    values: dict[str, float],
    given: Array,
    noise: Array,
    controller: int = OPEN,
    gains: tuple[float, ...] = (),
    bursts: Array | None = None,
    substeps: int = SUBSTEPS,
) -> Motion:
    """Run the axis from rest.

    Parameters
    ----------
    values : dict of str to float
        What differs from the nominal axis, names of `NAMES`.
    given : array, shape (n + 1,)
        Voltage [V], or the set-point [m] where there is a controller.
    noise : array, shape (n + 1,)
        Unmodelled friction [N] at the samples.
    controller : int
        `OPEN`, `PID`, `NCTF` or `IOL`.
    gains : tuple of float
        Of that controller.
    bursts : array, shape (number, 2), optional
        From when to when [s] the friction is raised.
    substeps : int
        Integration steps in a millisecond.
    """
    made = np.zeros((0, 2)) if bursts is None else bursts
    states, way, command, applied = _simulate(
        numbers(values),
        numbers({}),
        controller,
        np.array(gains, dtype=float),
        np.asarray(given, dtype=float),
        np.asarray(noise, dtype=float),
        made,
        substeps,
    )
    return Motion(*states.T.copy(), way, command, applied)


def friction_noise(random: np.random.Generator, count: int = SAMPLES + 1) -> Array:
    """Noise whose correlation falls exponentially, 2 % of the Coulomb force."""
    from scipy.signal import lfilter

    kept = math.exp(-SAMPLE / NOISE_TIME)
    rms = NOISE_SHARE * NOMINAL["Fc"]
    white = random.standard_normal(count) * rms * math.sqrt(1 - kept**2)
    white[0] = rms * random.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -kept], white))


@njit(cache=True, error_model="numpy")
def _along(q, x, v, way, bursts, gap, rigid):  # type: ignore[no-untyped-def]
    n = len(x) - 1
    force = np.zeros(n)
    parts = 5
    h = SAMPLE / parts
    z, block = 0.0, x[0]
    for k in range(n):
        for j in range(parts):
            s = (j + 0.5) / parts
            xs, vs = x[k] + s * (x[k + 1] - x[k]), v[k] + s * (v[k + 1] - v[k])
            t = (k + s) * SAMPLE
            burst = 0.0
            for b in range(len(bursts)):
                if bursts[b, 0] <= t < bursts[b, 1]:
                    burst = 1.0
            touching = True
            if gap > 0.0:
                touching = abs(xs - block) >= 0.5 * gap
                if touching:
                    block = xs - (0.5 * gap if xs > block else -0.5 * gap)
                else:
                    vs = 0.0
                xs = block
            ws = way[k] + s * (way[k + 1] - way[k])
            curve, both = _scales(q, xs, vs, t, ws, burst)
            g = _stribeck(q, vs) * curve
            f = q[S2] * both * vs + _other(q, xs, vs)
            sign = 1.0 if vs > 0 else (-1.0 if vs < 0 else 0.0)
            if rigid:
                f += sign * g
            elif sign != 0.0:
                end = sign * g / q[S0]
                new = end + (z - end) * math.exp(-q[S0] * abs(vs) * h / g)
                f += q[S0] * 0.5 * (z + new) + q[S1] * (new - z) / h
                z = new
            else:
                f += q[S0] * z
            if touching:
                force[k] += f / parts
    return force


def force_along(
    values: dict[str, float],
    position: Array,
    speed: Array,
    way: Array,
    bursts: Array | None = None,
    gap: float = 0.0,
    rigid: bool = False,
) -> Array:
    """Friction and the other forces of the block along a motion, the mean of each millisecond [N].

    With a `gap` the motion is the screw's and the block is dragged; `rigid`: without bristles.
    """
    made = np.zeros((0, 2)) if bursts is None else bursts
    return np.asarray(_along(numbers(values), position, speed, way, made, gap, rigid))
