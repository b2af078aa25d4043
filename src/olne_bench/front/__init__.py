"""What ``import olne_bench`` offers, one file per verb; ``olne_bench/__init__.py`` lists it."""
