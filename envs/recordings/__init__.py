"""Recordings of motions, their files, and worlds that play them."""
