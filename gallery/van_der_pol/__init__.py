"""Van der Pol's oscillator."""
