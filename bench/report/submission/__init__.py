"""Submissions: pack runs for a pull request, and check them before they are accepted."""
