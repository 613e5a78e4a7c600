"""What a hidden effect amounts to in a record: its signal-to-noise ratio, from the truth alone.

A signal is what the effect changes in the balance of forces along the true motion, for records
without current; with current there are two balances, of forces and of voltages. It is weighed in
the frequency domain by the density of what cannot be known: rounding of the encoder, current noise,
friction noise. What a refit of the believed parameters takes up is projected out.

A stretch counts with the weight v^2/(v^2 + (0.5 mm/s)^2). While the block rests the bristle's force
follows the encoder's error, a constant of up to 0.1 N then, and not white: a force difference there
is hidden in truth, and would be counted without that weight. Above 200 Hz nothing counts: a voltage
held for a millisecond and balances of means over a millisecond say little there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from hidden.effects import (
    COUNT,
    CURRENT_NOISE,
    DURATION,
    NAMES,
    NOISE_SHARE,
    NOISE_TIME,
    NOMINAL,
    SAMPLE,
    SAMPLES,
    Array,
    Motion,
    force_along,
    numbers,
)

RESTING = 5e-4  # m/s
BAND = 200.0  # Hz
PRIOR = 0.03 / math.sqrt(3)  # of a believed parameter that is off by up to 3 %
LUGRE = ("sigma0", "sigma1", "sigma2", "Fc", "Fs", "Vs")
CLASSICAL = ("sigma2", "Fc", "Fs", "Vs")
BASE = dict(zip(NAMES, numbers({}), strict=True))

# Effects that are believed parameters, or nearly one: known to 3 % before, not free.
KNOWN_BEFORE = frozenset({"unmodelled_inertia", "parameter_error", "compliance"})
WRONG = ("Fc", "Fs", "sigma2", "kt", "ke", "R", "sigma0")
NO_BURSTS = np.zeros((0, 2))


@dataclass(frozen=True)
class Scene:
    """A true motion, what made it, and what of it is recorded."""

    motion: Motion
    values: Mapping[str, float]
    with_current: bool
    law: str
    bursts: Array = field(default_factory=lambda: NO_BURSTS)

    def _mean(self, samples: Array) -> Array:
        return np.asarray((samples[1:] + samples[:-1]) / 2)

    @property
    def weight(self) -> Array:
        """How far a stretch counts."""
        speed = self._mean(self.motion.motor_speed)
        return np.asarray(speed**2 / (speed**2 + RESTING**2))

    def forces(self, block: bool = True, rigid: bool = False, **changed: float) -> Array:
        """True friction and the rest along the motion, with some numbers changed [N]."""
        m = self.motion
        x, v = (m.position, m.speed) if block else (m.motor_position, m.motor_speed)
        return force_along(dict(self.values) | changed, x, v, m.way, self.bursts, rigid=rigid)

    def believed(self, gap: float = 0.0, **changed: float) -> Array:
        """The same of the law as it is believed, along the motion as it is recorded."""
        m, rigid = self.motion, self.law == "classical"
        return force_along(changed, m.motor_position, m.motor_speed, m.way, gap=gap, rigid=rigid)

    def as_force(self, force: Array) -> Array:
        """The signal of a force, shape (balances, samples)."""
        return np.stack([force, np.zeros_like(force)]) if self.with_current else force[None]

    def as_voltage(self, voltage: Array) -> Array:
        """The signal of a voltage."""
        if self.with_current:
            return np.stack([np.zeros_like(voltage), voltage])
        return np.asarray(voltage[None] * BASE["kt"] / BASE["R"])

    def late(self, delay: float) -> Array:
        """The signal of a command that comes late [s].

        A sample of the current, which settles in 45 us, shows the voltage of its instant and not
        the mean of the millisecond before: a fraction of a millisecond is seen in the force alone.
        """
        command = self.motion.command
        mean = _delayed(command, delay)
        if not self.with_current:
            return self.as_voltage(command[:-1] - mean)
        at_sample = _delayed(command, int(delay / SAMPLE) * SAMPLE)
        force = BASE["kt"] / BASE["R"] * (at_sample - mean)
        return np.stack([force, command[:-1] - at_sample])

    def sprung(self, softness: float) -> Array:
        """The signal of a soft spring [m/N] between screw and block, to first order."""
        m = self.motion
        stiff = self.believed()
        through = np.convolve(stiff + BASE["m"] * self.acceleration, [0.5, 0.5])
        speed = m.motor_speed - np.gradient(through * softness, SAMPLE)
        soft = force_along({}, m.motor_position, speed, m.way, rigid=self.law == "classical")
        inertia = BASE["m"] * np.diff(speed - m.motor_speed) / SAMPLE
        return self.as_force(soft - stiff + inertia)

    @property
    def acceleration(self) -> Array:
        """Of the motor's side, the mean of each millisecond [m/s^2]."""
        return np.diff(self.motion.motor_speed) / SAMPLE

    def current(self) -> Array:
        """The mean of each millisecond, but for the electrical time constant [A]."""
        drift = 1 + self.values.get("R_drift", 0.0) * times() / DURATION
        back = BASE["ke"] * self._mean(self.motion.motor_speed)
        return np.asarray((self.motion.applied - back) / (BASE["R"] * drift))

    def believed_current(self) -> Array:
        """What the believed model needs for the motion [A].

        The true current would not do for the parameters' signals: it holds the effect, and with all
        parameters free to be scaled together, the effect would explain itself.
        """
        mass = BASE["m"] + BASE["rotor"]
        return np.asarray((mass * self.acceleration + self.believed()) / BASE["kt"])

    def derivative(self, name: str) -> Array:
        """The signal of a relative change of one believed parameter."""
        if name == "m":
            return self.as_force(-BASE["m"] * self.acceleration)
        if name == "Jm":
            return self.as_force(-BASE["rotor"] * self.acceleration)
        if name == "kt":
            return self.as_force(BASE["kt"] * self.believed_current())
        if name == "R":
            return self.as_voltage(-BASE["R"] * self.believed_current())
        if name == "ke":
            return self.as_voltage(-BASE["ke"] * self._mean(self.motion.motor_speed))
        step = 0.02
        high = self.believed(**{name: BASE[name] * (1 + step)})
        low = self.believed(**{name: BASE[name] * (1 - step)})
        return self.as_force(-(high - low) / (2 * step))

    @property
    def parameters(self) -> tuple[str, ...]:
        """Believed parameters that may be wrong."""
        return ("m", "Jm", "kt", "ke", "R", *(CLASSICAL if self.law == "classical" else LUGRE))


def spectrum(signals: Array) -> Array:
    """Discrete Fourier transform along the last axis, as far as it counts."""
    return np.asarray(np.fft.rfft(signals, axis=-1)[..., : len(frequencies())])


def frequencies() -> Array:
    """Those that count [Hz]."""
    return np.arange(int(BAND * SAMPLES * SAMPLE) + 1) / (SAMPLES * SAMPLE)


def times() -> Array:
    """Middles of the milliseconds [s]."""
    return (np.arange(SAMPLES) + 0.5) * SAMPLE


def whitening(with_current: bool) -> Array:
    """Per frequency what makes the noise of the balances white, of unit variance.

    Shape (frequencies, balances, balances), for `SAMPLES` samples in numpy's rfft: the inverse
    Cholesky factor of the density.
    """
    w = 2 * math.pi * frequencies()
    kept = math.exp(-SAMPLE / NOISE_TIME)
    friction = (NOISE_SHARE * NOMINAL["Fc"]) ** 2 * (1 - kept**2)
    friction = friction / np.abs(1 - kept * np.exp(-1j * w * SAMPLE)) ** 2
    through = noise_paths(with_current)
    variances = np.stack(
        [np.full(len(w), COUNT**2 / 12), np.full(len(w), CURRENT_NOISE**2), friction]
    )
    density = np.einsum("faj,jf,fbj->fab", through, variances, through.conj()) * SAMPLES
    return np.asarray(np.linalg.inv(np.linalg.cholesky(density)))


def noise_paths(with_current: bool) -> Array:
    """How encoder error, current noise and friction noise enter the balances, per frequency."""
    s = 2j * math.pi * frequencies()
    mass = BASE["m"] + BASE["rotor"]
    lag = 1 + s * BASE["L"] / BASE["R"]
    zero, one = np.zeros_like(s), np.ones_like(s)
    inertia = -(mass * s**2 + BASE["sigma2"] * s)
    if with_current:
        force = [inertia, BASE["kt"] * one, one]
        voltage = [-BASE["ke"] * s, -(BASE["R"] + BASE["L"] * s), zero]
        return np.asarray(np.stack([np.stack(force, -1), np.stack(voltage, -1)], -2))
    back = BASE["kt"] * BASE["ke"] / BASE["R"] * s / lag
    return np.asarray(np.stack([np.stack([inertia - back, zero, one], -1)], -2))


_FACTORS: dict[bool, Array] = {}


class Scale:
    """Weighs signals of one scene; distances are in standard deviations of the noise."""

    def __init__(self, scene: Scene, known_before: bool = False, also_free: tuple[Array, ...] = ()):
        if scene.with_current not in _FACTORS:
            _FACTORS[scene.with_current] = whitening(scene.with_current)
        self.factor = _FACTORS[scene.with_current]
        self.weight = scene.weight
        columns = [self.white(scene.derivative(n)) for n in scene.parameters]
        self.whitened_parameters = np.stack(columns, 1)
        self.prior = None
        free = [self.white(a) for a in also_free]
        if known_before:
            self.prior = self.whitened_parameters * PRIOR
            # (I + J P J')^-1 as the square of a matrix that leaves what J does not reach
            left, size, _ = np.linalg.svd(self.prior, full_matrices=False)
            self._left, self._shrink = left, 1 - 1 / np.sqrt(1 + size**2)
            free = [self._shrunk(f) for f in free]
        else:
            free = [*columns, *free]
        self.basis = _orthonormal(np.stack(free, 1)) if free else np.zeros((len(columns[0]), 0))

    def _shrunk(self, white: Array) -> Array:
        return np.asarray(white - self._left @ (self._shrink * (self._left.T @ white)))

    def white(self, signal: Array) -> Array:
        """A signal as a vector in which the noise has unit variance in each direction."""
        return self.white_spectrum(spectrum(signal * self.weight))

    def white_spectrum(self, transform: Array) -> Array:
        """The same for a spectrum, shape (balances, frequencies), weighted already."""
        white = np.einsum("fab,bf->fa", self.factor, transform)
        white[1:] *= math.sqrt(2.0)
        return np.concatenate([white.real.ravel(), white.imag.ravel()])

    def left(self, signal: Array) -> Array:
        """The vector of a signal, without what the believed parameters take up."""
        white = self.white(signal)
        if self.prior is not None:
            white = self._shrunk(white)
        return np.asarray(white - self.basis @ (self.basis.T @ white))

    def snr(self, signal: Array) -> float:
        """The signal-to-noise ratio."""
        return float(np.linalg.norm(self.left(signal)))


def _orthonormal(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    left, singular, _ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
    return np.asarray(left[:, singular > 1e-6 * max(singular[0], 1e-300)])


def signal(scene: Scene, effect: str, sizes: Mapping[str, object]) -> Array:
    """What one effect of a scene leaves in its balances: what drives, less what is believed of it,
    inertia and friction."""
    motion, values = scene.motion, scene.values
    if effect == "parameter_error":
        return np.asarray(scene.derivative(str(sizes["parameter"])) * float(str(sizes["relative"])))
    if effect == "unmodelled_inertia":
        return scene.as_force((values["m"] - NOMINAL["m"]) * scene.acceleration)
    if effect == "resistance_drift":
        drift = values["R_drift"] * times() / DURATION
        return scene.as_voltage(BASE["R"] * drift * scene.current())
    if effect == "input_delay":
        return scene.late(values["delay"])
    if effect == "voltage_saturation":
        return scene.as_voltage(motion.command[:-1] - motion.applied)
    if effect == "presliding_hysteresis":
        return scene.as_force(scene.forces() - scene.forces(rigid=True))
    if effect in ("backlash", "compliance"):
        inertia = values.get("m", NOMINAL["m"]) * (
            np.diff(motion.speed) - np.diff(motion.motor_speed)
        )
        return scene.as_force(scene.forces() - scene.forces(block=False) + inertia / SAMPLE)
    # Everything else is a force term, or a factor in one: without it, along the same motion.
    without = dict.fromkeys(ZERO_WITHOUT[effect], 0.0)
    return scene.as_force(scene.forces() - scene.forces(**without))


ZERO_WITHOUT = {
    "direction_asymmetry": ("asymmetry",),
    "position_periodic_friction": ("periodic",),
    "position_trend_friction": ("trend",),
    "torque_ripple": ("ripple",),
    "load_bias": ("load",),
    "nonlinear_viscous": ("s3",),
    "stribeck_mismatch": ("rise",),
    "friction_drift": ("drift",),
    "detent": ("detent",),
    "bursts": ("burst",),
    "reversal_memory": ("memory",),
}


def explanations(scene: Scene) -> dict[str, list[Callable[[], Array]]]:
    """For every cause of the catalogue the families, shape (columns, balances, samples) each, of
    signals it could have in this motion."""
    x = scene.motion.motor_position
    plain = {"middle": float(x.min() + x.max()) / 2, "half_range": float(np.ptp(x)) / 2}
    there, rigid = scene.believed(), scene.law == "classical"

    def term(*changes: dict[str, float]) -> Callable[[], Array]:
        def family() -> Array:
            forces = [scene.believed(**plain, **c) for c in changes]
            return np.stack([scene.as_force(f - there) for f in forces])

        return family

    def quarter(name: str, size: float, **other: float) -> Callable[[], Array]:
        phase = f"{name}_phase"
        return term({name: size, phase: 0.0, **other}, {name: size, phase: -math.pi / 2, **other})

    def voltage(difference: Callable[[], Array]) -> Callable[[], Array]:
        return lambda: scene.as_voltage(difference())[None]

    def relative(name: str) -> Callable[[], Array]:
        return lambda: scene.derivative(name)[None]

    command = scene.motion.command
    peak = float(np.abs(command).max())

    def delayed(tau: float) -> Callable[[], Array]:
        return lambda: scene.late(tau)[None]

    def limited(share: float) -> Callable[[], Array]:
        top = peak * (1 - share)
        return voltage(lambda: (command - np.clip(command, -top, top))[:-1])

    def lost(gap: float) -> Callable[[], Array]:
        return lambda: scene.as_force(scene.believed(gap) - there)[None]

    def bristles(stiffness: float) -> Callable[[], Array]:
        elastic = force_along({"sigma0": stiffness}, x, scene.motion.motor_speed, scene.motion.way)
        return lambda: scene.as_force(elastic - there)[None]

    def sprung(softness: float) -> Callable[[], Array]:
        return lambda: scene.sprung(softness)[None]

    families = {
        "direction_asymmetry": [term({"asymmetry": 0.02})],
        "position_periodic_friction": [quarter("periodic", 0.02)],
        "position_trend_friction": [term({"trend": 0.02})],
        "torque_ripple": [quarter("ripple", 0.02, ripple_n=float(n)) for n in (1, 2, 4, 6)],
        "load_bias": [term({"load": 0.02})],
        "nonlinear_viscous": [term({"s3": 20.0})],
        "stribeck_mismatch": [term({"rise": 0.05, "V2": v}) for v in (3e-3, 4e-3, 6e-3, 1e-2)],
        "unmodelled_inertia": [relative("m")],
        "input_delay": [delayed(tau) for tau in (2e-4, 1e-3, 4e-3)],
        "friction_drift": [term({"drift": 0.05})],
        "resistance_drift": [
            voltage(lambda: BASE["R"] * times() / DURATION * scene.believed_current())
        ],
        "backlash": [lost(gap) for gap in (3e-6, 1e-5, 3e-5, 1e-4)],
        "voltage_saturation": [limited(share) for share in (0.002, 0.01, 0.05, 0.2)],
        "parameter_error": [relative(n) for n in WRONG if n in scene.parameters],
    }
    if rigid:
        # without bristles a spring before the block is a kind of bristle
        families["compliance"] = [bristles(k) for k in (5e3, 2e4, 7e4, 2e5, 1e6)]
    else:
        families["compliance"] = [sprung(c) for c in (3e-7, 1e-6, 3e-6, 1e-5)]
    return families


def _delayed(command: Array, tau: float) -> Array:
    whole = int(tau / SAMPLE)
    late = tau / SAMPLE - whole
    padded = np.concatenate([np.zeros(whole + 1), command])
    return np.asarray(late * padded[:SAMPLES] + (1 - late) * padded[1 : SAMPLES + 1])


def same_force(
    scene: Scene, scale: Scale, effect: str, found: Array, threshold: float
) -> Iterator[str]:
    """Other causes of the catalogue that leave less than `threshold` of an effect's signal."""
    target = scale.left(found)
    for name, families in explanations(scene).items():
        if name == effect:
            continue
        for family in families:
            signals = family()
            columns = np.stack([scale.left(s) for s in signals], 1)
            whole = np.stack([scale.white(s) for s in signals], 1)
            if not np.linalg.norm(columns) > 1e-4 * np.linalg.norm(whole):
                continue  # the believed parameters take all of it up, or there is none
            basis = _orthonormal(columns)
            if np.linalg.norm(target - basis @ (basis.T @ target)) < threshold:
                yield name
                break
