"""Judging of trials: ground truth, observations, and errors of estimates."""
