"""What a trial's truth is, what is observed of it, and how far an estimate is from it."""
