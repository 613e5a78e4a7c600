"""A linear drive of 40 kg whose command is its force."""

HEAVY = {
    "m": 40.0,
    "sigma2": 200.0,
    "Fc": 80.0,
    "Fs": 80.0,
    "Vs": 0.01,
    "sigma0": 1e7,
    "sigma1": 2e4,
}
