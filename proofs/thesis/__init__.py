"""Chapter 3 of the thesis, section by section: computed results, and claims of the thesis."""
