"""A mass with dry friction under PID control."""
