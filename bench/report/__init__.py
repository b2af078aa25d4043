"""What a run says: tables, statistics, figures and the page."""
