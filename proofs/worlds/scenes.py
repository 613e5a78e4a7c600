"""A world's draw ready for simulation: motions, friction noise, instruments; and its records."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, sosfiltfilt

from worlds import axis as at
from worlds.axis import changed, double_of, mass_of
from worlds.machines import Conditions, Rng, log_uniform, pick
from worlds.simulator import BURST, FLAT, RELATIVE, SPACING, TEXTURE_PHASE, read_all, simulate

LOGGED_AT_LEAST = 5e-4  # longest logging period, s
SHOWN_WITHIN = 0.01  # motion of less than the encoder's error in this time is rest, s
UNSEEN_WAY = 0.02e-6  # bristles with a shorter presliding distance have no effect, m
LARGEST_JITTER = 0.45  # share of the period: stamps stay in order

Columns = dict[str, np.ndarray]
Motion = tuple[np.ndarray, np.ndarray]  # the simulator's log and commands


def wanted_motion(rng: Rng, conditions: Conditions, time: np.ndarray) -> np.ndarray:
    """Commands [V], or references [m] with a controller, at times [s]."""
    axis, kind = conditions.axis, conditions.excitation
    if conditions.loop == "open":
        least = axis.values["Fs"] / axis.values["Fc"] * axis.command(0.0)  # breaks it away
        way = 0.25 * axis.travel / axis.fastest * axis.command(axis.fastest)
        most = axis.most * log_uniform(rng, 0.3, 1.0)
        return _OPEN_LOOP[kind](rng, time, most, least, way)
    fastest = axis.fastest * log_uniform(rng, 0.4, 1.0)
    half = 0.7 * axis.travel * float(rng.uniform(0.3, 1.0))
    return _CLOSED_LOOP[kind](rng, time, half, fastest)


# Commands in V that oscillate about zero: between the smallest that breaks the axis away and the
# largest; the integral in one direction is limited, V*s.


def _steps(rng: Rng, time: np.ndarray, most: float, least: float, way: float) -> np.ndarray:
    """Steps up and back, some with a rest in between."""
    signal, at, sign = np.zeros(time.size), 0.0, 1.0
    while at < time[-1]:
        height = log_uniform(rng, 1.5 * least, most)
        long = min(float(rng.uniform(0.1, 1.0)), way / height)
        rest = float(rng.choice([0.0, 0.0, rng.uniform(0.05, 0.3)]))
        for part in (sign, -sign):
            signal[(time >= at) & (time < at + long)] = part * height
            at += long + rest
        sign = -sign
    return signal


def _ramps(rng: Rng, time: np.ndarray, most: float, least: float, way: float) -> np.ndarray:
    """Triangles, every other one smaller."""
    period = time[-1] / rng.integers(3, 9)
    high = min(most, 2.5 * least + 4 * way / period)
    triangle = 4 * np.abs((time / period + 0.25) % 1.0 - 0.5) - 1
    return -high * triangle * np.where(np.floor(time / period) % 2 == 0, 1.0, 0.6)


def _multisine(rng: Rng, time: np.ndarray, most: float, least: float, way: float) -> np.ndarray:
    tones = np.exp(rng.uniform(np.log(0.3), np.log(25.0), rng.integers(5, 12)))
    tones = np.maximum(np.round(tones * time[-1]), 2) / time[-1]
    weights = np.minimum(most, 2 * np.pi * tones * way) * rng.uniform(0.3, 1.0, tones.size)
    parts = zip(weights, tones, rng.uniform(0, 2 * np.pi, tones.size), strict=True)
    total = np.sum([w * np.sin(2 * np.pi * f * time + p) for w, f, p in parts], axis=0)
    return total * min(1.0, most / np.abs(total).max()) * rng.uniform(0.5, 1.0)


def _chirp(rng: Rng, time: np.ndarray, most: float, least: float, way: float) -> np.ndarray:
    now, angle = _rising(rng.uniform(0.2, 0.6), rng.uniform(8.0, 30.0), time)
    swing = np.minimum(most, 2.0 * least + 2 * np.pi * now * way)
    return swing * rng.uniform(0.5, 1.0) * np.sin(angle)


def _rising(low: float, high: float, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies that rise exponentially, Hz, and their angle."""
    rate = np.log(high / low) / time[-1]
    now = low * np.exp(rate * time)
    return now, 2 * np.pi * (now - low) / rate


# References in m about zero, limited to half of the travel and to a speed.


def _laps(rng: Rng, time: np.ndarray, half: float, fastest: float) -> np.ndarray:
    legs = [(s * half, fastest * f) for f in (1.0, 0.3, 0.1) for s in (0.9, -0.9)]
    return _profile(rng, legs * 60, time)


def _points(rng: Rng, time: np.ndarray, half: float, fastest: float) -> np.ndarray:
    places = rng.uniform(-half, half, 200)
    speeds = fastest * np.exp(rng.uniform(np.log(0.02), 0.0, 200))
    return _profile(rng, list(zip(places, speeds, strict=True)), time)


def _sines(rng: Rng, time: np.ndarray, half: float, fastest: float) -> np.ndarray:
    tones = np.exp(rng.uniform(np.log(0.15), np.log(4.0), rng.integers(2, 6)))
    swing = np.minimum(half, fastest / (2 * np.pi * tones)) / tones.size
    parts = zip(swing, tones, rng.uniform(0, 2 * np.pi, tones.size), strict=True)
    from_zero = np.exp(-3 * time)
    waves = (s * (np.sin(2 * np.pi * f * time + p) - np.sin(p) * from_zero) for s, f, p in parts)
    return np.sum([*waves], axis=0)


def _sweep(rng: Rng, time: np.ndarray, half: float, fastest: float) -> np.ndarray:
    now, angle = _rising(rng.uniform(0.1, 0.3), rng.uniform(3.0, 10.0), time)
    return np.minimum(half, fastest / (2 * np.pi * now)) * np.sin(angle)


def _one_way(rng: Rng, time: np.ndarray, half: float, fastest: float) -> np.ndarray:
    """From one end to the other in a few moves in one direction, with long rests between."""
    count = int(rng.integers(4, 10))
    places = np.sort(np.append(rng.uniform(-half, half, count - 1), [-half, half]))
    moves = np.diff(places)
    speeds = fastest * np.exp(rng.uniform(np.log(0.05), 0.0, count))
    rests = rng.uniform(0.3, 1.5, count)
    spare = 0.9 * time[-1] - rests.sum()
    speeds = np.minimum(speeds * max((moves / speeds).sum() / spare, 0.05), fastest)
    stamps, line = [0.0], [-half]
    for place, move, speed, rest in zip(places[1:], moves, speeds, rests, strict=True):
        stamps += [stamps[-1] + rest, stamps[-1] + rest + move / speed]
        line += [line[-1], place]
    return _rounded(np.interp(time, stamps, line), time)


def _profile(rng: Rng, legs: list[tuple[float, float]], time: np.ndarray) -> np.ndarray:
    """From position to position at given speeds."""
    at, rest = 0.1, float(rng.uniform(0.02, 0.2))
    stamps, places = [0.0, at], [0.0, 0.0]
    for place, speed in legs:
        at += max(abs(place - places[-1]) / speed, 0.02)
        stamps += [at, at + rest]
        places += [place, place]
        at += rest
        if at > time[-1]:
            break
    return _rounded(np.interp(time, stamps, places), time)


def _rounded(line: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Smoothed by a moving mean over 0.1 s."""
    wide = max(int(0.1 / (time[1] - time[0])), 1)
    smooth = np.convolve(np.pad(line, (wide, 0), mode="edge"), np.ones(wide) / wide, "valid")
    return smooth[: time.size]


_OPEN_LOOP = {"steps": _steps, "ramps": _ramps, "multisine": _multisine, "chirp": _chirp}
_CLOSED_LOOP = {
    "laps": _laps, "points": _points, "sines": _sines, "sweep": _sweep, "one_way": _one_way,
}  # fmt: skip


def slow_noise(rng: Rng, count: int, period: float, correlation_time: float) -> np.ndarray:
    """First-order noise of unit variance, one value per period, shape (count,); times in [s]."""
    keep = np.exp(-period / correlation_time)
    white = rng.standard_normal(count) * np.sqrt(1 - keep**2)
    white[0] = rng.standard_normal()
    return lfilter([1.0], [1.0, -keep], white)


def draw_noise(
    rng: Rng, conditions: Conditions, axis: np.record, count: int, correlation_time: float
) -> tuple[np.ndarray, np.ndarray]:
    """Noise of the control periods, shape (count, 3), and friction fixed to the position.

    Its growth with the speed, and the beginning of the tables, are set in the axis.
    """
    kind, size, period = conditions.noise, conditions.noise_size, conditions.period
    noise, tables = np.zeros((count, 3)), FLAT
    way = log_uniform(rng, 30e-6, 2e-3)
    if kind == "white":
        noise[:, RELATIVE] = size * rng.standard_normal(count)
    elif kind == "slow":
        noise[:, RELATIVE] = size * slow_noise(rng, count, period, correlation_time)
    elif kind == "growing_with_speed":
        noise[:, RELATIVE] = size * slow_noise(rng, count, period, min(correlation_time, 0.03))
        axis.noise_growth = float(rng.uniform(5.0, 40.0))
    elif kind.startswith("texture"):
        places = int(2.4 * axis.travel / SPACING) + 2
        tables = size * np.stack([slow_noise(rng, places, SPACING, way) for _ in range(2)])
        axis.texture_start = -1.2 * axis.travel
        if kind == "texture_not_repeating":
            turned = np.cumsum(rng.standard_normal(count)) * np.sqrt(period / 2.0)
            noise[:, TEXTURE_PHASE] = turned
    return noise, tables


@dataclass(frozen=True)
class Instruments:
    """The instruments of one record (the encoder's counts belong to the axis)."""

    encoder: str  # kinds as in the odds of `Conditions`
    current: str
    cutoff: float  # of filtered positions, share of the sampling frequency; in both directions
    noise: float  # of the current, A, also below
    offset: float
    gain: float
    lag: float  # s
    step: float


def draw_instruments(rng: Rng, conditions: Conditions) -> Instruments:
    encoder, current = pick(rng, conditions.encoders), pick(rng, conditions.currents)
    spoilt = current == "offset_and_gain"
    cutoff = float(rng.uniform(0.08, 0.3))
    noise = 1e-3 if current == "good" else float(rng.uniform(1e-3, 5e-3))
    return Instruments(
        encoder, current, cutoff, conditions.current_noise * noise,
        offset=float(rng.uniform(-0.02, 0.02)) if spoilt else 0.0,
        gain=1 + (float(rng.uniform(-0.025, 0.025)) if spoilt else 0.0),
        lag=log_uniform(rng, 1e-4, 8e-4) if current == "filtered" else 0.0,
        step=float(rng.choice([5e-3, 1e-2, 2e-2])) if current == "coarse" else 0.0,
    )  # fmt: skip


@dataclass(frozen=True)
class Scene:
    conditions: Conditions
    instruments: Instruments
    double: np.record  # the axis with the law of its parameter file, without any effect
    faultless: np.record  # the same with the machine's friction, encoder and noise
    wanted: np.ndarray
    noise: np.ndarray
    tables: np.ndarray
    rng: Rng
    tolerated: dict[str, float] = field(default_factory=dict)  # invisible properties, if noisy
    # of all records without an effect: the motion, and the largest command, V, speed, m/s, and
    # distance from the middle, m; factor on the upper ends of sizes of effects
    motion: Motion = (np.zeros(0), np.zeros(0))
    peak: float = 0.0
    fastest: float = 0.0
    reach: float = 0.0
    shrink: float = 1.0

    @property
    def logged(self) -> int:
        """Number of logging periods in a control period."""
        return int(np.ceil(self.conditions.period / LOGGED_AT_LEAST - 1e-9))

    @property
    def per_sample(self) -> int:
        """Number of logging periods in a sampling period."""
        return self.logged * self.conditions.faster

    @property
    def with_current(self) -> bool:
        return self.instruments.current != "none"

    def taken(self, **other) -> Scene:
        """The same with something else, and its motion without an effect."""
        scene = replace(self, **other)
        return replace(scene, motion=scene.run({}))

    def size(self, rng: Rng, low: float, high: float) -> float:
        """A random size of an effect, log-uniform; it begins at less with little noise."""
        low *= self.conditions.finest
        return log_uniform(rng, low, max(high * self.shrink, 2 * low))

    def run(self, changes: dict[str, float], *, clean: bool = False) -> Motion:
        """Log and commands of the axis with changes, with or without noise and instruments."""
        axis = changed(self.faultless, changes if clean else self.tolerated | changes)
        noise = np.zeros_like(self.noise) if clean else self.noise.copy()
        if axis.bursts:
            noise[:, BURST] = self._bursts(axis.bursts)
        if clean:
            axis.resolution = axis.interpolation = 0.0
        period, logged = self.conditions.period, self.logged
        substeps = logged * int(np.ceil(period / logged / self.conditions.substep - 1e-9))
        course = self.wanted, noise, FLAT if clean else self.tables
        log, commands = simulate(axis, self.double, *course, substeps, logged, period)
        skipped = self.conditions.periods(self.conditions.lead_in)
        return log[skipped * self.logged :], commands[skipped:]

    def _bursts(self, force: float) -> np.ndarray:
        """Half sines of 5 to 50 ms; the same ones for the same scene."""
        rng = np.random.default_rng(int(1e6 * self.conditions.duration))
        line = np.zeros(len(self.noise))
        for _ in range(int(rng.integers(3, 12))):
            long = int(rng.uniform(0.005, 0.05) / self.conditions.period) + 2
            start = int(rng.integers(0, max(line.size - long, 1)))
            shape = np.sin(np.linspace(0, np.pi, long))[: line.size - start]
            line[start : start + shape.size] += rng.choice([-1, 1]) * force * shape
        return line


def make_scenes(conditions: Conditions, rng: Rng, *, bare: bool) -> tuple[Scene, ...]:
    """Motion, noise and instruments of every record; `bare` is without bristles in the law."""
    axis = conditions.axis
    if bare:
        values = {n: v for n, v in axis.values.items() if n not in ("sigma0", "sigma1")}
        axis = replace(axis, law="classical", values=values, formulation=at.SET_VALUED)
        conditions = replace(conditions, axis=axis)
    instruments = draw_instruments(rng, conditions)
    double = changed(double_of(axis, conditions.duration), _controller(conditions))
    double.least_speed = (conditions.resolution + conditions.interpolation) / SHOWN_WITHIN
    double.ramped = conditions.command == "ramped"
    faultless = changed(double, {"law": axis.formulation})
    if axis.law == "classical" and axis.formulation != at.SET_VALUED:
        # invisibly stiff bristles: a user would choose the classical law
        faultless.sigma0 = axis.values["Fs"] / UNSEEN_WAY
        faultless.sigma1 = np.sqrt(faultless.sigma0 * mass_of(faultless))
    if instruments.encoder != "exact":
        faultless.resolution = conditions.resolution
    faultless.floors = instruments.encoder == "floor"
    if instruments.encoder == "interpolated":
        faultless.interpolation, faultless.signal_period = conditions.interpolation, 20e-6
    count, skipped = (conditions.periods(t) for t in (conditions.duration, conditions.lead_in))
    drawn = log_uniform(rng, 0.003, 0.3)
    time = conditions.correlation_time or drawn
    noise, tables = draw_noise(rng, conditions, faultless, count + skipped, time)
    wanted = wanted_motion(rng, conditions, np.arange(count) * conditions.period)
    if skipped:  # from the middle to the start, with a rest there
        before = np.arange(skipped) * conditions.period
        share = np.minimum(before / (0.8 * before[-1]), 1.0)
        wanted = np.append(0.5 * wanted[0] * (1 - np.cos(np.pi * share)), wanted)
    first = Scene(conditions, instruments, double, faultless, wanted, noise, tables, rng)
    if conditions.excitation != "one_way":
        return (first,)
    noise, _ = draw_noise(rng, conditions, faultless.copy(), wanted.size, time)
    return first, replace(first, wanted=-wanted, noise=noise)


def _controller(conditions: Conditions) -> dict[str, float]:
    """Gains from the axis' first-order response and the bandwidth of its velocity."""
    if conditions.loop == "open":
        return {}
    par = double_of(conditions.axis, conditions.duration)
    if par.is_drive:
        per_speed, per_acceleration = par.sigma2 / par.gain, mass_of(par) / par.gain
    else:
        per_speed = par.ke + par.R * par.sigma2 / par.kt
        per_acceleration = par.R * mass_of(par) / par.kt
    angular = 2 * np.pi * min(conditions.bandwidth, 0.04 / conditions.sampling)
    gain, outer = angular * per_acceleration, angular / 5
    integral = max(angular * per_speed, 0.25 * angular * gain)
    said = {"most": conditions.axis.most, "filter": 0.15 / angular, "position_gain": outer}
    if conditions.loop == "cascade":
        return said | {"loop": at.CASCADE, "gain_p": gain, "gain_i": integral}
    more = {"gain_p": gain * outer + integral, "gain_i": integral * outer, "gain_d": gain}
    return said | more | {"loop": at.PID}


def sampled(shape: np.ndarray, per_sample: int) -> np.ndarray:
    """The log's rows averaged over sampling periods; shape (..., rows) to (..., samples)."""
    count = shape.shape[-1] // per_sample
    cut = shape[..., : count * per_sample]
    return cut.reshape(*shape.shape[:-1], count, per_sample).mean(-1)


def make_record(scene: Scene, motion: Motion, changes: dict[str, float]) -> tuple[Columns, Columns]:
    """The columns of a record, and errors of x [m], i [A] and u [V], if there are any."""
    conditions, axis = scene.conditions, changed(scene.faultless, changes)
    if conditions.jitter or conditions.resampled:
        return _uneven(scene, motion, axis)
    log, commands = motion[0][:: scene.per_sample], motion[1]
    averaged = conditions.command == "averaged"
    record = {
        "time": np.arange(log.size) * conditions.sampling,
        "u": sampled(commands, conditions.faster) if averaged else commands[:: conditions.faster],
        "x": read_position(scene.instruments, axis, log["x"]),
    }
    errors = {"x": record["x"] - log["x"]}
    if scene.with_current:
        record["i"], errors["i"] = _read_current(scene, log["current"], conditions.sampling)
    return record, errors


def read_position(instruments: Instruments, axis: np.record, x: np.ndarray) -> np.ndarray:
    """The column x of a record from the true positions at its samples."""
    read = read_all(axis, x)
    if instruments.encoder == "filtered":
        read = sosfiltfilt(butter(4, 2 * instruments.cutoff, output="sos"), read)
    return read


def _read_current(scene: Scene, i: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The column i from the true currents at its samples, and its error."""
    sensor, read = scene.instruments, np.array(i)
    rng = np.random.default_rng(i.size)  # separate: other random values do not change
    if sensor.lag > 0:
        keep = np.exp(-period / sensor.lag)
        read = lfilter([1 - keep], [1.0, -keep], read)
    read = sensor.gain * read + sensor.offset
    read += sensor.noise * rng.standard_normal(read.size)
    if sensor.step > 0:
        read = np.round(read / sensor.step) * sensor.step
    line = np.polyfit(i, read, 1)  # a user fits a sensor's gain and offset
    return read, read - np.polyval(line, i)


def _uneven(scene: Scene, motion: Motion, axis: np.record) -> tuple[Columns, Columns]:
    """A record with jittering stamps, or one resampled from another period.

    Stamps are true, positions and currents are those at the stamps, and a command is the mean until
    the next stamp. Resampling is linear between samples.
    """
    conditions, (log, commands) = scene.conditions, motion
    own = conditions.sampling * (conditions.resampled or 1.0)
    until = len(commands) * scene.conditions.period
    stamps = np.arange(int(until / own + 1e-9)) * own
    if conditions.jitter:
        rng = np.random.default_rng([len(log), int(1e6 * conditions.duration)])
        off = conditions.jitter * rng.standard_normal(stamps.size)
        stamps = np.maximum(stamps + own * np.clip(off, -LARGEST_JITTER, LARGEST_JITTER), 0.0)
    rows = np.arange(len(log)) * scene.conditions.period / scene.logged
    place = CubicSpline(rows, log["x"])
    record = {
        "time": stamps,
        "u": _means(commands, scene.conditions.period, np.append(stamps, until)),
        "x": read_position(scene.instruments, axis, place(stamps)),
    }
    errors = {}
    if scene.with_current:
        i = np.interp(stamps, rows, log["current"])
        record["i"], errors["i"] = _read_current(scene, i, own)
    if conditions.resampled:
        even = np.arange(int(stamps[-1] / conditions.sampling) + 1) * conditions.sampling
        record = {n: np.interp(even, stamps, column) for n, column in record.items()}
        ends = np.append(even, min(even[-1] + conditions.sampling, until))
        errors = {n: np.interp(even, stamps, column) for n, column in errors.items()}
        errors["u"] = record["u"] - _means(commands, scene.conditions.period, ends)
    return record, errors | {"x": record["x"] - place(record["time"])}


def _means(commands: np.ndarray, period: float, ends: np.ndarray) -> np.ndarray:
    """Means of held commands between times."""
    whole = np.concatenate([[0.0], np.cumsum(commands) * period])
    edges = np.arange(whole.size) * period
    return np.diff(np.interp(ends, edges, whole)) / np.diff(ends)
