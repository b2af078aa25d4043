"""Submissions: runs packed for a pull request, and how they are checked before they count."""
