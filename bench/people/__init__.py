"""A study of recorded drivers: their moments, how each method predicts them, and how well."""
