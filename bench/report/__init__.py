"""Reports of runs: tables, statistics, figures and the page."""
