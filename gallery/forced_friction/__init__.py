"""A mass on a spring with dry friction, driven harmonically."""
