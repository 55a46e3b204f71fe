"""Counters of a fleet of stations over years, with the truth beside them."""
