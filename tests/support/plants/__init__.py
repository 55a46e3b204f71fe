"""Models of heater and tip that share no code with `jbclog.sim`, and how joints found on them are
scored.
"""
