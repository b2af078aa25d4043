"""Commands of ``olne-bench``, one file each; ``interface`` says how they are called."""
