"""The five experiments of Section 2.4 on every friction law, and Table 2.12 that comes of them."""
