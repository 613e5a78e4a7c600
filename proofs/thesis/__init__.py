"""Chapter 3 of the thesis, section by section: what is computed, and what is claimed."""
