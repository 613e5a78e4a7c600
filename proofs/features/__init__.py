"""The five experiments of Section 2.4 on every friction law, and the resulting Table 2.12."""
