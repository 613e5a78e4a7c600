"""A friction oscillator on a moving belt."""
