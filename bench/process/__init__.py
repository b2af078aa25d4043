"""Child processes: starting, limiting, talking to and ending them, with all their descendants."""
