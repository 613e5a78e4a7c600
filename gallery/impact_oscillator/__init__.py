"""A forced oscillator that strikes a rigid stop."""
