"""A servo with dry friction under PD control that compensates friction."""
