"""Where traffic comes from: scenarios and their recordings."""
