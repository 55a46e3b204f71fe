"""Put tools in their safe state and prove it, for a run, the guard or a person.

Start with `secure.py`: the feeder first, then each tool, in rounds, read back. `orders.py` sends
the orders, `cooling.py` decides whether a tool cools, `time_budget.py` limits each step.
"""
