"""A DC motor with friction under position control."""
